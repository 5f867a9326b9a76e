"""Which headway and gains to choose: a question, its requirements, a Pareto set, named designs."""

from cacc_platoon.design.question import Question, answer
from cacc_platoon.design.recommend import recommend
from cacc_platoon.design.requirements import (
    Design,
    Recommendation,
    Requirements,
    assess,
    paper_design,
)

__all__ = [
    "Design",
    "Question",
    "Recommendation",
    "Requirements",
    "answer",
    "assess",
    "paper_design",
    "recommend",
]
