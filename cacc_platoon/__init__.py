"""Choose, run, record and judge a connected platoon under noisy V2V communication."""

__version__ = "0.2.0"
