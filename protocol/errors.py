"""Every error that this project raises on purpose.

    Hoap3Error
    ├── UsageError              the user's words are wrong: exit code 2
    │   ├── ConfigError         a file, a key, a value, and what to write instead
    │   │   └── NoDefaultTaskError  neither the config nor the robot says what to do
    │   ├── UnknownNameError    a name that nobody registered; carries the nearest ones
    │   │   └── NotInstalledError  a name that is known, of something that is not installed
    │   ├── DescriptionError    a robot description that cannot be used
    │   ├── FrameNotFoundError  carries the frames that the robot has
    │   ├── NameTakenError      a robot of that name is alive already
    │   ├── PortInUseError      somebody listens there already
    │   └── LogError            a log that is not ours, or damaged beyond reading
    ├── WireError               bytes that are not a message of ours
    ├── AuthorityError          somebody else may command the robot; carries the holder
    ├── LinkError               the other side cannot be reached, or went away
    └── SolverError             a problem that has no answer
        ├── InfeasibleError     no input satisfies the constraints
        └── BadProblemError     wrong shape, not finite, or a parameter outside its range

Each message says what was found, where, and what to do about it.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import islice

LONGEST_KEY = 200  # characters of a dotted key that an error shows
LONGEST_GUESS = 64  # characters of a name for which the nearest is looked for
MOST_GUESSES = 1000  # names that it is compared with


class Hoap3Error(Exception):
    """Root of the tree."""


class UsageError(Hoap3Error):
    """What the user asked for cannot be done; the command ends with exit code 2."""


class ConfigError(UsageError):
    """A setting is wrong.

    Attributes:
        file: where it was read, or the command-line option that set it.
        key: dotted path inside the file, "" for the file as a whole.
        value: what was found.
        problem: what is wrong with it.
        remedy: what is allowed, or what to do.
        others: what else is wrong there; each is a line of the message.
    """

    def __init__(
        self,
        file: str,
        key: str,
        value: object,
        problem: str,
        remedy: str,
        others: Iterable[ConfigError] = (),
    ) -> None:
        self.file, self.key, self.value = file, key, value
        self.problem, self.remedy = problem, remedy
        self.others = tuple(others)
        where = ": ".join(filter(None, (file, _cut(key))))
        found = "" if value is None else f" (found {_short(value)})"
        lines = [f"{where}: {problem}{found}. {remedy}", *map(str, self.others)]
        super().__init__("\n".join(lines))


class LimitWarning(UserWarning):
    """A config has a limit above its robot's, which is not what counts then."""


class UrdfWarning(UserWarning):
    """What was read, guessed and left out where a robot was made of a vendor's URDF."""


class NoDefaultTaskError(ConfigError):
    """A config names no task, and neither does the robot."""


class UnknownNameError(UsageError):
    """Nothing is registered under that name.

    Attributes:
        kind: what was looked for, such as "controller".
        name: what was asked for.
        known: every name that would do.
        nearest: the most alike of them, or None.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str], hint: str = "") -> None:
        self.kind, self.name, self.known = kind, name, sorted(known)
        self.nearest = nearest(name, self.known)
        guess = f" Did you mean {self.nearest!r}?" if self.nearest else ""
        listing = ", ".join(self.known) or "none"
        super().__init__(f"no {kind} is called {_short(name)}.{guess} Known: {listing}.{hint}")


class NotInstalledError(UnknownNameError):
    """The name is known, but what it names is not installed.

    Attributes:
        package: what to install.
    """

    def __init__(self, kind: str, name: str, package: str) -> None:
        problem = f"the {kind} {name!r} is not installed"
        UsageError.__init__(self, f"{problem}: pip install {package}")
        self.kind, self.name, self.known, self.nearest = kind, name, [name], None
        self.package = package


class DescriptionError(UsageError):
    """A robot description, its URDF or its YAML, cannot be used."""


class FrameNotFoundError(UsageError):
    """The robot has no such frame.

    Attributes:
        frame: what was asked for.
        known: the frames that the robot has.
    """

    def __init__(self, frame: str, robot: str, known: Iterable[str]) -> None:
        self.frame, self.known = frame, sorted(known)
        listing = one_of(frame, self.known, "Frames")
        super().__init__(f"robot {robot!r} has no frame {_short(frame)}. {listing}.")


class NameTakenError(UsageError):
    """A robot of that name is alive on the network already."""


class PortInUseError(UsageError):
    """The address to listen on is taken."""


class LogError(UsageError):
    """A log that cannot be read as one of ours."""


class WireError(Hoap3Error):
    """Bytes that are not a message of ours.

    Attributes:
        kind: the name under which the rejection is counted.
    """

    def __init__(self, kind: str, message: str) -> None:
        self.kind = kind
        super().__init__(message)


class AuthorityError(Hoap3Error):
    """The robot grants no authority.

    Attributes:
        holder: the controller that it follows; None where it does not see our liveliness token.
    """

    def __init__(self, robot: str, holder: str | None) -> None:
        self.holder = holder
        if holder is None:
            reason = (
                "does not see this controller's liveliness token, though it answers; if a router "
                "is between them, let it pass `robots/*/clients/*`"
            )
        else:
            reason = f"follows {holder!r} already; stop that controller first"
        super().__init__(f"robot {robot!r} {reason}")


class LinkError(Hoap3Error):
    """The other side cannot be reached, or went away."""


class SolverError(Hoap3Error):
    """A problem that a solver could not answer."""


class InfeasibleError(SolverError):
    """No input satisfies the constraints."""


class BadProblemError(SolverError, ValueError):
    """Wrong shape, a value that is not finite, or a parameter outside its range.

    Attributes:
        key: the parameter that a config calls so, "" where it is none.
    """

    def __init__(self, message: str, key: str = "") -> None:
        self.key = key
        super().__init__(message)


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The most alike of the known names, or None if none is alike.

    Long words and long lists are not compared: that takes time that grows with their product.
    """
    if len(name) > LONGEST_GUESS:
        return None
    words = [word for word in islice(known, MOST_GUESSES) if len(word) <= LONGEST_GUESS]
    found = difflib.get_close_matches(name, words, n=1, cutoff=0.5)
    return found[0] if found else None


def did_you_mean(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """A remedy for a name that is not known: the most alike of those that are."""
    found = nearest(name, known)
    return f"Did you mean {found!r}?" if found else otherwise


def one_of(name: str, known: Iterable[str], what: str) -> str:
    """The same, with all that are known behind it, such as "Joints: shoulder, elbow"."""
    known = list(known)
    return f"{did_you_mean(name, known)} {what}: {', '.join(known) or 'none'}".lstrip()


@contextmanager
def located(file: str, key: str = "") -> Iterator[None]:
    """Say where a setting stands that is found wrong inside.

    Whoever checks a setting raises a `ConfigError` with file "" and the key as it knows it; this
    puts `key` before it, and names the file. An error that names a file already stays as it is.
    """
    try:
        yield
    except ConfigError as error:
        if error.file:
            raise
        raise _at(error, file, key) from error


def _at(error: ConfigError, file: str, key: str) -> ConfigError:
    """The same error, and the others in it, below a key of a file."""
    if error.file:
        return error
    where = ".".join(filter(None, (key, error.key)))
    others = [_at(each, file, key) for each in error.others]
    return type(error)(file, where, error.value, error.problem, error.remedy, others)


def _short(value: object) -> str:
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits, or a deep nest
        return f"a {type(value).__name__} that is too large to print"
    return text if len(text) <= 80 else f"{text[:30]}...{text[-47:]}"


def _cut(key: str) -> str:
    return key if len(key) <= LONGEST_KEY else key[: LONGEST_KEY - 3] + "..."
