"""Standard output holds the answer alone, whatever libraries and child processes print there."""

import subprocess
import sys

PROGRAM = """
import os, subprocess
from cacc_platoon.cli.console import libraries_on_stderr
print("answer begins")
with libraries_on_stderr():
    os.write(1, b"a library complains\\n")
    subprocess.run(["echo", "a child complains"])
print("answer ends")
"""


def test_libraries_and_children_complain_on_stderr():
    result = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True)
    assert result.stdout == "answer begins\nanswer ends\n"
    assert result.stderr == "a library complains\na child complains\n"
