"""Imports point one way; what a room may use is written here, and nothing else passes."""

import ast
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
ROS = {"rclpy", "std_srvs", "geometry_msgs", "std_msgs", "rosgraph_msgs", "rcl_interfaces"}
ROS |= {"builtin_interfaces", "diagnostic_msgs", "visualization_msgs"}


class Room(NamedTuple):
    """What a room may import: other rooms, packages at its top, packages inside functions."""

    rooms: set[str]
    top: set[str]
    inside: set[str] = set()  # noqa: RUF012, never changed


MODEL = {"errors", "texts", "model"}
SCENARIO = MODEL | {"formats", "scenario"}
RUNS = SCENARIO | {"stepping", "simulation", "msg_adapters", "bags", "runs"}
JUDGED = RUNS | {"theory", "analysis"}
ROOMS = {
    "errors": Room(set(), set()),
    "formats": Room({"errors"}, set()),
    "texts": Room(set(), set()),
    "notation": Room(set(), set()),
    "stop_signal": Room(set(), set()),
    "time_limit": Room(set(), set()),
    "dds": Room({"errors"}, set()),
    "model": Room({"errors", "texts"}, {"numpy"}),
    "theory": Room(MODEL, {"numpy"}),
    "scenario": Room({*MODEL, "formats"}, {"numpy", "ruamel"}),
    "design": Room({*MODEL, "formats", "theory"}, {"numpy"}),
    "stepping": Room(SCENARIO, {"numpy"}),
    "simulation": Room(SCENARIO, {"numpy"}),
    "msg_adapters": Room(SCENARIO, {"numpy"}),
    "bags": Room({*SCENARIO, "msg_adapters"}, {"numpy", "ruamel", "rosbags"}),
    "runs": Room(RUNS, {"numpy"}),
    "nodes": Room({*RUNS, "stepping"}, ROS),
    "analysis": Room(JUDGED, {"numpy"}),
    "figures": Room({*JUDGED, "design", "notation"}, {"numpy"}, {"matplotlib"}),
    "supervision": Room(
        {*RUNS, "stop_signal", "time_limit", "dds", "stepping", "nodes"}, {"numpy", *ROS}
    ),
    "live": Room({*RUNS, "supervision"}, set(), {"foxglove"}),
    "sweep": Room({*JUDGED, "design"}, {"numpy"}, {"distributed", "pyarrow", "scipy"}),
    "report": Room({*JUDGED, "design", "figures", "notation"}, {"numpy", "ruamel"}, {"matplotlib"}),
    "replay": Room({*JUDGED, "figures"}, {"numpy"}),
    "testing": Room({*RUNS, "dds", "nodes", "supervision"}, {"numpy", *ROS}),
    "campaign": Room(
        {*JUDGED, "stop_signal", "dds", "nodes", "supervision", "testing"}, {"numpy", *ROS}
    ),
    "reproduction": Room({*JUDGED, "figures", "notation", "report"}, {"numpy"}),
    "cli": Room(
        {
            *JUDGED,
            *("stop_signal", "dds", "design", "figures", "live", "report", "replay"),
            *("reproduction", "sweep"),
        },
        {"numpy", "ruamel"},
        {"nodes", "supervision", "campaign", *ROS},
    ),
}


def room_of(module: str) -> str:
    """Return the room of a module of ours, or the package of somebody else's."""
    parts = module.split(".")
    if parts[0] != "cacc_platoon" or len(parts) == 1:
        return parts[0]
    return "cli" if parts[1] == "__main__" else parts[1]


def imports(tree: ast.AST, inside: bool = False):
    """Yield (module, whether it is imported only when a function runs or a type is checked)."""
    for node in ast.iter_child_nodes(tree):
        match node:
            case ast.Import(names=names):
                yield from ((name.name, inside) for name in names)
            case ast.ImportFrom(module=module, names=names, level=0):
                yield module, inside
                if module == "cacc_platoon":
                    modules = [name.name for name in names if not name.name.startswith("__")]
                    yield from ((f"cacc_platoon.{name}", inside) for name in modules)
            case ast.ImportFrom():
                yield ".", inside
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.Lambda():
                yield from imports(node, True)
            case ast.If(test=ast.Name(id="TYPE_CHECKING"), body=body, orelse=orelse):
                yield from imports(ast.Module(body, []), True)
                yield from imports(ast.Module(orelse, []), inside)
            case _:
                yield from imports(node, inside)


def breaches(room: str, source: str) -> list[str]:
    """Return the modules that a source text imports and its room may not."""
    allowed = ROOMS[room]
    found = []
    for module, inside in imports(ast.parse(source)):
        target = room_of(module)
        at_top = allowed.rooms | allowed.top | {room, "cacc_platoon", "__future__"}
        if target in sys.stdlib_module_names or target in at_top:
            continue
        if not (inside and target in allowed.inside):
            found.append(module)
    return found


def sources() -> list[Path]:
    paths = [*(ROOT / "cacc_platoon").rglob("*.py"), *(ROOT / "msg_adapters").rglob("*.py")]
    return sorted(path for path in paths if path != ROOT / "cacc_platoon" / "__init__.py")


@pytest.mark.parametrize("path", sources(), ids=lambda path: str(path.relative_to(ROOT)))
def test_a_file_imports_only_what_its_room_may(path):
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    room = room_of(module)
    assert room in ROOMS, "a new room: say here what it may import"
    assert breaches(room, path.read_text()) == []


def test_the_package_itself_imports_nothing():
    assert list(imports(ast.parse((ROOT / "cacc_platoon" / "__init__.py").read_text()))) == []


@pytest.mark.parametrize(
    ("room", "source"),
    [
        ("model", "import rclpy"),
        ("model", "import scipy.linalg"),
        ("model", "from cacc_platoon import simulation"),
        ("model", "from cacc_platoon.scenario import Scenario"),
        ("model", "def f():\n    import rclpy"),
        ("design", "from cacc_platoon.simulation import simulate"),
        ("report", "import matplotlib"),
        ("theory", "from cacc_platoon.scenario import Scenario"),
        ("scenario", "from cacc_platoon.theory import certify"),
        ("cli", "from cacc_platoon.testing import Platoon"),
        ("cli", "def run():\n    from cacc_platoon.testing import Platoon"),
        ("cli", "from cacc_platoon.campaign.trials import try_all"),
        ("supervision", "from cacc_platoon.campaign.plan import plan"),
        ("analysis", "from cacc_platoon.report import summary"),
        ("simulation", "from msg_adapters.topics import Topic"),
        ("scenario", "if True:\n    from cacc_platoon.simulation import simulate"),
        ("msg_adapters", "from rclpy.serialization import serialize_message"),
        ("msg_adapters", "from cacc_platoon.nodes import qos"),
        ("nodes", "from cacc_platoon.analysis import metrics"),
        ("nodes", "from cacc_platoon.design import certificate"),
        ("analysis", "try:\n    import rclpy\nexcept ImportError:\n    pass"),
        ("cli", "from cacc_platoon.supervision.host import run_host"),
        ("cli", "import rclpy"),
        ("errors", "from cacc_platoon.model import Gains"),
        ("model", "from . import channel"),
    ],
)
def test_a_breach_is_seen(room, source):
    assert breaches(room, source) != []


def test_what_is_allowed_passes():
    assert (
        breaches("cli", "def run():\n    from cacc_platoon.supervision.host import run_host") == []
    )
    source = "if TYPE_CHECKING:\n    import matplotlib\nimport numpy as np\nimport math"
    assert breaches("report", source) == []


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def file_graph(texts: dict[str, str]) -> dict[str, set[str]]:
    """Return which of these modules each one imports, wherever in its file."""
    graph: dict[str, set[str]] = {}
    for module, text in texts.items():
        graph[module] = set()
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and node.module:
                inner = {f"{node.module}.{name.name}" for name in node.names}
                graph[module] |= (inner & texts.keys()) or ({node.module} & texts.keys())
    return graph


def circles(graph: dict[str, set[str]]) -> list[str]:
    """Return the modules that are in a circle or lead into one, none when there is no circle."""
    left = dict(graph)
    while done := [name for name, targets in left.items() if not targets & left.keys()]:
        for name in done:
            del left[name]
    return sorted(left)


def test_no_file_imports_itself_in_a_circle():
    paths = [*sources(), ROOT / "cacc_platoon" / "__init__.py"]
    assert circles(file_graph({module_of(path): path.read_text() for path in paths})) == []


def test_a_circle_is_seen():
    inside = "if TYPE_CHECKING:\n    from a.c import C"
    texts = {"a.b": inside, "a.c": "def f():\n    from a import d", "a.d": "from a.b import B"}
    assert circles(file_graph(texts)) == ["a.b", "a.c", "a.d"]
    assert circles(file_graph({**texts, "a.d": "import math"})) == []
