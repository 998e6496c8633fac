"""``run.yaml``: what was asked, on what, by whom."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

from bench.store.data import RunHeader, Sensor
from bench.store.errors import RunError
from bench.store.layout import RUN_FORMAT, check_format
from protocols.points import Roi

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["header_from", "read_header", "read_yaml", "use_plain_values"]

#: A float in YAML 1.2; PyYAML by itself knows those of YAML 1.1, where ``1e16`` is a text.
_FLOAT = re.compile(r"([-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN))$")
_MISSING = object()


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping in the YAML file `path`; numbers as in YAML 1.2 (``1e3`` is one), dates stay text.

    Raises
    ------
    RunError
        If the file is not there, is not YAML, or holds no mapping.
    """
    import yaml

    try:
        content = yaml.load(path.read_text(encoding="utf-8"), _loader())  # noqa: S506 - a subclass of SafeLoader
    except OSError as error:
        raise RunError(f"{path}: {error.strerror or error}") from error
    except yaml.YAMLError as error:
        raise RunError(f"{path}: not YAML: {' '.join(str(error).split())}") from error
    except (ValueError, RecursionError) as error:  # not UTF-8, an impossible number, nested without end
        raise RunError(f"{path}: not YAML: {error}") from error
    if not isinstance(content, dict):
        raise RunError(f"{path}: expected keys and values, found {type(content).__name__}")
    return content


def _loader() -> Any:
    import yaml

    class Loader(yaml.SafeLoader):
        """YAML as other tools write it: floats as in YAML 1.2, dates as text."""

    use_plain_values(Loader)
    return Loader


def use_plain_values(kind: Any) -> None:
    """Let a class of PyYAML's loaders or dumpers take dates for text, and for floats what YAML 1.2 does."""
    kind.yaml_implicit_resolvers = {
        first: [(tag, pattern) for tag, pattern in resolvers if not tag.endswith((":timestamp", ":float"))]
        for first, resolvers in kind.yaml_implicit_resolvers.items()
    }
    kind.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789."))


def read_header(path: Path) -> RunHeader:
    """Return what the file ``run.yaml`` at `path` says.

    Raises
    ------
    RunError
        In one line: the file is not there, not YAML, of a newer format, or lacks a key that must be there.
    """
    return header_from(read_yaml(path), str(path))


def header_from(content: dict[str, Any], where: str) -> RunHeader:
    """Return the header that `content`, the keys of a ``run.yaml``, describes; `where` begins each error."""
    check_format(content.get("format"), RUN_FORMAT, where)
    sensor = _mapping(content, "sensor", where)
    return RunHeader(
        id=_text(content, "id", where),
        sensor=_sensor(sensor, f"{where}: sensor"),
        roi=_roi(_mapping(content, "roi", where), f"{where}: roi"),
        title=str(content.get("title") or ""),
        created=str(content.get("created") or ""),
        everything=content,
    )


def _sensor(content: dict[str, Any], where: str) -> Sensor:
    """Pitch and efficiency are NaN where the file does not tell them: unknown, not assumed."""
    return Sensor(
        name=_text(content, "name", where),
        width=_whole(content, "width", where, lowest=1),
        height=_whole(content, "height", where, lowest=1),
        pixel_pitch_m=_positive(content, "pixel_pitch_m", where, math.nan),
        quantum_efficiency=_positive(content, "quantum_efficiency", where, math.nan),
        photons_per_lux=_positive(content, "photons_per_lux", where, 1.12e16),
    )


def _roi(content: dict[str, Any], where: str) -> Roi:
    return Roi(
        x=_whole(content, "x", where, lowest=0),
        y=_whole(content, "y", where, lowest=0),
        width=_whole(content, "width", where, lowest=1),
        height=_whole(content, "height", where, lowest=1),
    )


def _get(content: dict[str, Any], key: str, where: str) -> Any:
    value = content.get(key, _MISSING)
    if value is _MISSING or value is None:
        raise RunError(f"{where}: the key {key!r} is missing")
    return value


def _mapping(content: dict[str, Any], key: str, where: str) -> dict[str, Any]:
    value = _get(content, key, where)
    if not isinstance(value, dict):
        raise RunError(f"{where}: {key} is {value!r}, expected keys and values")
    return value


def _text(content: dict[str, Any], key: str, where: str) -> str:
    value = _get(content, key, where)
    if isinstance(value, dict | list):
        raise RunError(f"{where}: {key} is {value!r}, expected text")
    return str(value)


def _whole(content: dict[str, Any], key: str, where: str, lowest: int) -> int:
    value = _get(content, key, where)
    if isinstance(value, bool) or not isinstance(value, int | float) or value != _truncated(value) or value < lowest:
        raise RunError(f"{where}: {key} is {value!r}, expected a whole number of at least {lowest}")
    if value > 2**31:
        raise RunError(f"{where}: {key} is {value!r}, which no sensor has")
    return int(value)


def _truncated(value: float) -> float:
    """Return `value` without its fraction, NaN where it is not finite."""
    return math.trunc(value) if math.isfinite(value) else math.nan


def _positive(content: dict[str, Any], key: str, where: str, missing: float) -> float:
    value = content.get(key)
    if value is None:
        return missing
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
        raise RunError(f"{where}: {key} is {value!r}, expected a positive number")
    return float(value)
