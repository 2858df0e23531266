"""Prints what the package needs, one requirement a line, without torch: python .ci/requirements.py [--oldest].

--oldest: exactly the least version of each. Needs Python 3.11.
"""

import re
import sys
from pathlib import Path

import tomllib

project = tomllib.loads(Path(__file__).parents[1].joinpath("pyproject.toml").read_text(encoding="utf-8"))["project"]
for requirement in project["dependencies"]:
    if requirement.startswith("torch"):  # wheels for few versions of Python at once, and too large to fetch for each
        continue
    if "--oldest" in sys.argv:
        requirement = re.sub(r">=\s*([\d.]+)[^;]*", r"==\1", requirement)
    print(requirement)
