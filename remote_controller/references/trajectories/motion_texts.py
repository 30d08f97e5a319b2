"""The content of the files that trajectories name, in the settings themselves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

KIND, FILE, TEXT = "trajectory", "file", "csv"
Entry = Mapping[str, Any]


def trajectories(parameters: Any) -> Iterator[Entry]:
    """Every setting of a trajectory that names a file, anywhere inside."""
    if isinstance(parameters, Mapping):
        if parameters.get("kind") == KIND and isinstance(parameters.get(FILE), str):
            if parameters[FILE]:
                yield parameters
            return
        parameters = list(parameters.values())
    if isinstance(parameters, list | tuple):
        for each in parameters:
            yield from trajectories(each)


def with_texts(parameters: Any, text_of: Callable[[Entry], str | None]) -> Any:
    """A copy in which each of them that has no content yet has that of its file.

    Args:
        parameters: of a controller.
        text_of: gives it; None leaves the entry as it is.
    """

    def filled(entry: Entry) -> Entry:
        text = None if entry.get(TEXT) else text_of(entry)
        return entry if text is None else {**entry, TEXT: text}

    return _changed(parameters, filled)


def without_texts(parameters: Any) -> Any:
    """A copy in which none of them has the content of its file."""
    return _changed(parameters, lambda entry: {key: entry[key] for key in entry if key != TEXT})


def _changed(parameters: Any, change: Callable[[Entry], Entry]) -> Any:
    if isinstance(parameters, Mapping):
        if next(trajectories(parameters), None) is parameters:
            return dict(change(parameters))
        return {key: _changed(value, change) for key, value in parameters.items()}
    if isinstance(parameters, list | tuple):
        return [_changed(each, change) for each in parameters]
    return parameters
