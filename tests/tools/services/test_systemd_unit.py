"""Units of systemd: what they say, where they are written, and what is refused."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.certificates.laboratory import laboratory
from support.command_bench import inside

from hoap3.protocol.errors import ConfigError, UsageError
from hoap3.tools.services.systemd_unit import MARK, WATCHDOG_S, install, quoted

SIDES = {"emulator": "hoap3", "controller": "qp12"}


def read(path: Path) -> dict[str, dict[str, list[str]]]:
    """Every value of every key of a unit, by section."""
    found: dict[str, dict[str, list[str]]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("["):
            section = found.setdefault(line.strip("[]"), {})
        elif line and not line.startswith("#"):
            key, _, value = line.partition("=")
            section.setdefault(key, []).append(value)
    return found


@pytest.mark.parametrize("side", SIDES)
def test_a_unit_runs_the_command_with_what_it_needs(side: str, tmp_path: Path) -> None:
    done = inside(
        "service", "install", side, SIDES[side], "--set", "log.cap_mb=50", "--out", tmp_path
    )
    assert done.code == 0, done.stderr
    path = Path(done.stdout.strip())
    assert path.parent == tmp_path
    service = read(path)["Service"]
    program, *words = service["ExecStart"][0].split()
    assert Path(program).name == "hoap3"
    assert words == [side, SIDES[side], "--set", "log.cap_mb=50"]
    assert service["Type"] == ["notify"]
    assert service["NotifyAccess"] == ["all"]
    assert float(service["WatchdogSec"][0]) == WATCHDOG_S[side]
    assert service["LimitRTPRIO"] == ["99"]
    assert service["LimitMEMLOCK"] == ["infinity"]
    assert service["DynamicUser"] == ["yes"]
    assert service["CacheDirectory"] == [path.stem]


def test_a_config_is_found_from_any_folder_and_may_lie_at_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("my arm.yaml").write_text("robot: hoap3\n")
    installed = install("emulator", "my arm.yaml", [], out=tmp_path / "units", user="robots")
    assert installed.name == "hoap3-emulator-my-arm"
    service = read(installed.path)["Service"]
    assert f'"{tmp_path}/my arm.yaml"' in service["ExecStart"][0]
    assert service["User"] == ["robots"]
    assert "DynamicUser" not in service


def test_a_users_own_systemd_gets_no_more_than_it_can_grant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    installed = install("controller", "qp12", [], of_user=True)
    assert installed.path == tmp_path / "systemd" / "user" / "hoap3-controller-qp12.service"
    unit = read(installed.path)
    assert unit["Install"]["WantedBy"] == ["default.target"]
    assert not unit["Service"].keys() & {"User", "DynamicUser", "ProtectSystem", "PrivateDevices"}
    assert all("--user" in command for command in installed.next)


def test_logs_outside_the_services_folders_are_for_a_user_with_a_name(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    place = f"log.directory={logs}"
    with pytest.raises(ConfigError):
        install("emulator", "hoap3", [place], out=tmp_path, user="robots")  # no such folder
    logs.mkdir()
    with pytest.raises(ConfigError):
        install("emulator", "hoap3", [place], out=tmp_path)
    unit = read(install("emulator", "hoap3", [place], out=tmp_path, user="robots").path)
    assert unit["Service"]["ReadWritePaths"] == [str(logs)]
    none = ["log.record=false", f"log.directory={tmp_path}/none"]  # it writes none
    unit = read(install("emulator", "hoap3", none, out=tmp_path, user="robots").path)
    assert "ReadWritePaths" not in unit["Service"]


def test_our_own_unit_is_replaced_and_no_other(tmp_path: Path) -> None:
    path = install("emulator", "hoap3", [], out=tmp_path).path
    install("emulator", "hoap3", ["log.record=false"], out=tmp_path)
    assert "log.record=false" in path.read_text()
    assert path.read_text().startswith(MARK)
    path.write_text("[Service]\nExecStart=/bin/true\n")
    with pytest.raises(UsageError, match=path.name):
        install("emulator", "hoap3", [], out=tmp_path)
    assert path.read_text() == "[Service]\nExecStart=/bin/true\n"
    path.unlink()
    path.symlink_to("/dev/null")  # masked
    with pytest.raises(UsageError, match=path.name):
        install("emulator", "hoap3", [], out=tmp_path)


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("emulator", "hoap"), "hoap"),
        (("emulator", "hoap3", "--set", "robot=nosuch"), "nosuch"),
        (("emulator", "hoap3", "--set", "log.directory=/nowhere/logs"), "log.directory"),
        (("emulator", "hoap3", "--set", "misses_to_stop=0"), "misses_to_stop"),
        (("controller", "qp12", "--set", "parameters.u_max=1"), "u_max"),
        (("emulator", "hoap3", "--name", "a/b"), "a/b"),
        (("emulator", "hoap3", "--as", "No One"), "No One"),
        (("emulator", "hoap3", "--as", "root", "--user"), "--as"),
    ],
)
def test_what_would_not_run_is_refused_before_anything_is_written(
    words: tuple[str, ...], what: str, tmp_path: Path
) -> None:
    done = inside("service", "install", *words, "--out", tmp_path / "units")
    assert done.code == 2
    assert what in done.stderr
    assert not (tmp_path / "units").exists()


def test_a_service_with_a_certificate_is_checked_and_finds_it_from_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    laboratory(tmp_path / "certs", "hoap3")
    monkeypatch.chdir(tmp_path)
    given = {"out": tmp_path / "units", "user": "robots"}
    for side, who in (("emulator", "hoap3"), ("controller", "qp")):
        path = install(side, SIDES[side], [], secure=f"certs/{who}", **given).path
        assert f'link.secure=\\"{tmp_path}/certs/{who}\\"' in path.read_text()
    with pytest.raises(ConfigError, match="--as"):  # whom systemd makes cannot read the key
        install("emulator", "hoap3", [], secure="certs/hoap3", out=tmp_path)
    with pytest.raises(ConfigError, match=r"operator.*anna"):
        install("controller", "qp12", [], secure="certs/anna", **given)
    with pytest.raises(ConfigError, match=r"controller.*qp"):
        install("emulator", "hoap3", [], secure="certs/qp", **given)
    with pytest.raises(ConfigError, match=r"link\.secure"):
        install("emulator", "hoap3", ["link.secure=certs/hoap3"], **given)
    (tmp_path / "certs" / "hoap3" / "key.pem").unlink()
    with pytest.raises(ConfigError, match=r"key\.pem"):
        install("emulator", "hoap3", [], secure="certs/hoap3", **given)


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="--out"):
        install("emulator", "hoap3", [], out=tmp_path / "file")


@settings(max_examples=50)
@given(st.text(st.characters(codec="ascii", exclude_categories=["C"]), min_size=1, max_size=20))
def test_a_word_comes_through_systemds_quoting(word: str) -> None:
    assert unquoted(quoted(word)) == word


def unquoted(text: str) -> str:
    """A word as systemd.service(5) says that it is read."""
    if text.startswith('"'):
        assert text.endswith('"')
        text = text[1:-1]
        plain, at = "", 0
        while at < len(text):
            at += text[at] == "\\"
            plain += text[at]
            at += 1
        text = plain
    else:
        assert not set(text) & set(" \t'\"\\;")
    assert text.replace("%%", "").count("%") == text.replace("$$", "").count("$") == 0
    return text.replace("%%", "%").replace("$$", "$")


@pytest.mark.slow
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("user", [None, "daemon"])
def test_systemd_finds_no_fault_and_little_exposure(
    side: str, user: str | None, tmp_path: Path
) -> None:
    analyze = shutil.which("systemd-analyze")
    assert analyze, "this test needs systemd-analyze: apt-get install systemd"
    path = install(side, SIDES[side], [], out=tmp_path, user=user).path
    verified = subprocess.run(
        [analyze, "verify", str(path)], capture_output=True, text=True, check=False
    )
    assert (verified.returncode, verified.stdout, verified.stderr) == (0, "", "")
    words = [analyze, "security", "--offline=true", "--threshold=30", "--no-pager", str(path)]
    assert subprocess.run(words, capture_output=True, check=False).returncode == 0
