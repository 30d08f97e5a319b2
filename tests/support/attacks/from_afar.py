"""Attacks from this process on a robot in another network, as one JSON object.

`from_afar.py attacks PLACE CERTS WRAPPER...` starts robots behind the wrapper, and attacks them;
`from_afar.py doors PLACE CERTS OTHER` tries who is let in by one that runs.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from support.attacks.attacked_robot import FarRobot
from support.attacks.attacks import ATTACKS
from support.attacks.doors import doors
from support.attacks.scene import Scene


def attacked(place: str, folder: Path, wrapper: list[str]) -> dict[str, dict[str, bool]]:
    """Which attacks succeed, in plain and with certificates."""
    found: dict[str, dict[str, bool]] = {"plain": {}, "with certificates": {}}
    with FarRobot(wrapper) as robot:
        for name, attack in ATTACKS.items():
            for how, certs in zip(found, (None, folder), strict=True):
                scene = Scene(place, certs, robot.opened)
                try:
                    found[how][name] = attack(scene)
                finally:
                    scene.close()
    return found


if __name__ == "__main__":
    what, where, certs, *more = sys.argv[1:]
    if what == "doors":
        print(json.dumps(doors(where, Path(certs), Path(more[0]))))
    else:
        print(json.dumps(attacked(where, Path(certs), more)))
