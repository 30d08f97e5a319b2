"""Feeds every text parser long texts of each of its characters' classes, under a limit of CPU time.

    python tests/protocol/hostile_text.py BYTES SECONDS

prints, for each text, the name of the parser and of the text, the CPU time [s] and what became of
it. It ends early, by a signal, where all together take more than SECONDS, and with a traceback
where a parser raises anything but an error of ours.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from hoap3.protocol.config.settings import apply_overrides, parse, parse_yaml
from hoap3.protocol.errors import Hoap3Error, UnknownNameError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.urdf import read_urdf
from hoap3.remote_controller.config import ControllerConfig
from hoap3.remote_controller.references.settings import SplineSettings
from hoap3.remote_controller.references.trajectories.motion_file import read_motion
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.robots.yaml_file import RobotFile
from hoap3.tools.analysis.compare.candidates import split
from hoap3.tools.logs.log_format import pack_string, unpack_input

SINGLE = [*"019aexEn_+-.,:;?!*&#%@=|><~^$()[]{}'\"`/\\ \n\t\r\0\x1b\x85é𝟙", "\u2028", "\ufeff"]
SEVERAL = ["1:", ":59", "1,", "1 ", "1e", "e+", ".1", "1.", "0x", "0_", "a:\n", "- ", "? ", "-\n"]
SEVERAL += [": ", "a: ", "\n#", "\n%", "%TAG !a! b\n", "\n---\n", "*a ", "&a ", "!a ", "[]", "{}"]
SEVERAL += ["[{", '""', '"",', "'',", "\\u", "null,", "true,", "1,\n", "1,2,3,4\n", "a@", "@a="]
SEVERAL += ["<a>", "<a/>", "<a ", "</a>", "<!--", "-->", "<![CDATA[", "]]>", "<?a", "&amp;", "&#1;"]
SEVERAL += ['a="" ', "<link/>", "<joint/>", '<link name="a"/>', "<geometry><box/></geometry>"]
COUNTED = ["k{}:\n", "k{}: 1\n", "{}: [1]\n", '"k{}":1,', '"k{}":{{}},', 'k{}="" ', "'{}': {{}}, "]
COUNTED += ['<link name="l{}"/>', '<joint name="j{}" type="fixed"/>', 'xmlns:n{}="u" ', "k{}."]
COUNTED += ["{},1,2,3\n"]

ROBOT = '<robot name="r"><link name="a"/>{}</robot>'
MASS = '<robot name="r"><link name="a"><inertial><mass value="{}"/></inertial></link></robot>'
AXIS = '<robot><link name="a"/><joint name="j" type="fixed"><axis xyz="{}"/></joint></robot>'
PARENT = '<robot name="r">{}<joint name="j" type="fixed"><parent link="{}"/></joint></robot>'
LINKS = "".join(f'<link name="{"ab" * 31}{i:02x}"/>' for i in range(256))


def texts(size: int) -> Iterator[tuple[str, str]]:
    """Names of texts, and the texts: `size` characters of one class each.

    A regular expression that is ambiguous takes its time where a long match fails at its end.
    """
    for unit in SINGLE:
        yield f"{unit!r} and !", unit * (size - 1) + "!"
    for unit in [*SINGLE, *SEVERAL]:
        yield repr(unit), (unit * (size // len(unit) + 1))[:size]
    for unit in COUNTED:
        count = size // (len(unit) + 4)
        yield unit.replace("\n", "\\n"), "".join(unit.format(i) for i in range(count))[:size]


def parsers(folder: Path) -> dict[str, Callable[[str], object]]:
    """Everything that reads text which somebody else may have written."""
    table = folder / "a.csv"

    def csv(text: str) -> object:
        table.write_bytes(text.encode())
        return SplineSettings(kind="spline", file=table.name).build(folder)

    def motion(text: str) -> object:
        return read_motion(text, "a.csv", ("x", "a"), turns=True)

    def yaml(model: type, form: str) -> Callable[[str], object]:
        return lambda text: parse(model, parse_yaml(form.format(text), "a.yaml"), "a.yaml")

    def json(form: str) -> Callable[[str], object]:
        return lambda text: RobotDescription.from_json(form.replace("@", text).encode())

    def an_input(form: str) -> Callable[[str], object]:
        return lambda text: log_input(form.replace("@", text))

    def config(overrides: list[str]) -> object:
        return parse(ControllerConfig, apply_overrides({"controller": "qp12"}, overrides), "--set")

    return {
        "urdf": read_urdf,
        "urdf element": lambda text: read_urdf(ROBOT.format(text)),
        "urdf attributes": lambda text: read_urdf(ROBOT.format(f"<a {text}/>")),
        "urdf number": lambda text: read_urdf(MASS.format(text)),
        "urdf numbers": lambda text: read_urdf(AXIS.format(text)),
        "urdf name": lambda text: read_urdf(ROBOT.format(f'<link name="{text}"/>')),
        "urdf link": lambda text: read_urdf(PARENT.format(LINKS, text)),
        "yaml": yaml(ControllerConfig, "{}"),
        "yaml value": yaml(ControllerConfig, "controller: {}"),
        "yaml list": yaml(EmulatorConfig, "robot: [{}]"),
        "yaml mapping": yaml(EmulatorConfig, "{{{}}}"),
        "yaml key": yaml(EmulatorConfig, "{}: 1"),
        "yaml quoted": yaml(RobotFile, 'urdf: "{}"'),
        "yaml block": yaml(RobotFile, "urdf: |\n  {}"),
        "yaml joints": yaml(RobotFile, "name: a\nurdf: a\njoints: [{}]"),
        "--set": lambda text: config([text]),
        "--set value": lambda text: config([f"parameters={text}"]),
        "--set key": lambda text: config([f"{text}=1"]),
        "description": json("@"),
        "description name": json('{"name": "@"}'),
        "description urdf": json('{"urdf": "@"}'),
        "description joints": json('{"joints": [@]}'),
        "description number": json('{"period_s": @}'),
        "description postures": json('{"postures": {@}}'),
        "log input": an_input("@"),
        "log input stamp": an_input('{"kind": "state", "stamp": @, "repeated": true, "body": 1}'),
        "log input body": an_input('{"kind": "state", "stamp": 1, "repeated": true, "body": @}'),
        "log input malformed": an_input(
            '{"kind": "malformed", "stamp": 1, "repeated": true, '
            '"body": {"kind": "state", "base64": "@"}}'
        ),
        "csv": csv,
        "csv rows": lambda text: csv(f"t,x,y,z\n{text}"),
        "motion": motion,
        "motion rows": lambda text: motion(f"t,x,a\n{text}"),
        "candidate": split,
        "unknown name": lambda text: _raise(UnknownNameError("robot", text, ["hoap3", "ab" * 30])),
    }


def log_input(text: str) -> object:
    """Read a record of the topic `inputs`; its reader turns ValueError into an error of ours."""
    try:
        return unpack_input(pack_string(text))
    except ValueError as error:
        raise Hoap3Error(str(error)) from error


def _raise(error: Exception) -> None:
    raise error


def main() -> None:
    """Try all parsers on all texts."""
    size, cpu_s = map(int, sys.argv[1:])
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s))
    with tempfile.TemporaryDirectory() as folder:
        for parser, read in parsers(Path(folder)).items():
            for name, text in texts(size):
                print(f"{parser}\t{name}", end="\t", flush=True)
                before = time.process_time()
                try:
                    read(text)
                    outcome = "read"
                except Hoap3Error as error:
                    outcome = f"{type(error).__name__} of {len(str(error))} characters"
                print(f"{time.process_time() - before:.3f}\t{outcome}", flush=True)


if __name__ == "__main__":
    main()
