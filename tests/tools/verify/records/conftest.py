"""Puts the helpers of the folder above on the path of the tests here."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
