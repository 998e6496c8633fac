"""Making the devices of a station file, and seeing that they fit together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from bench.station.bias_map import QUANTITIES, BiasCurve, BiasMap
from bench.station.calibration import CalibratedFilter, Calibration
from bench.station.drivers import DriverNotFound, argument_problems, find_driver
from bench.station.station import Station
from bench.store.data import Sensor
from drivers.errors import DeviceError
from drivers.interfaces import EventCamera, FilterWheel, LightSource, World
from protocols.errors import InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bench.station.schema import BiasMapSection, StationFile
    from protocols.yaml_strict import Node

__all__ = ["assemble", "bias_map_of"]

_Path = tuple[str, ...]

_DEVICES: Final[dict[str, type[Any]]] = {"light": LightSource, "wheel": FilterWheel, "camera": EventCamera}
#: What a class must declare itself to be before it is called: a file that names another one runs nothing.
_KINDS: Final[dict[str, type[Any]]] = {"world": World, **_DEVICES}
_CLOCK_METHODS: Final = ("now", "sleep")


def assemble(file: StationFile, document: Node, source: str, *, blind: bool = False) -> Station:
    """Return the station of a file: its devices are made, none is connected.

    Parameters
    ----------
    file
        What it says.
    document
        The same with the place of each value.
    source
        Name of the file, for messages.
    blind
        Whether a run keeps nothing of the station but its name.

    Raises
    ------
    InputError
        With everything that is wrong: drivers that are not there, arguments that they do not take, devices that do
        not fit the calibration.
    """
    return _Assembly(file, document, source, blind).station()


class _Assembly:
    """One station on its way from file to devices; collects what is wrong."""

    def __init__(self, file: StationFile, document: Node, source: str, blind: bool) -> None:
        self._file = file
        self._document = document
        self._source = source
        self._blind = blind
        self._problems: list[Problem] = []
        believed = bias_map_of(file.calibration.bias_map)
        true = file.world.bias_map if file.world is not None else None
        self._known: dict[str, Any] = {
            "$bias_map": believed,
            "$true_bias_map": believed if true is None else bias_map_of(true),
        }

    def station(self) -> Station:
        """Return the station, or raise with all problems of the first step that has any."""
        classes = self._classes()
        self._stop_at_problems()
        made = self._made(classes)
        self._stop_at_problems()
        world = made.pop("world", None)
        calibration = self._calibration(made["light"])
        self._compare(made["light"], made["wheel"], made["camera"])
        self._stop_at_problems()
        return Station(
            name=self._file.name,
            **made,
            world=world,
            calibration=calibration,
            sensor=Sensor(**self._file.sensor.model_dump()),
            plan=self._file.model_dump(mode="json", by_alias=True),
            blind=self._blind,
        )

    def _classes(self) -> dict[_Path, type[Any]]:
        """Return the class of the world, the clock and each device, by its place in the file."""
        found = {}
        for path, driver, args in self._parts():
            cls = self._class(path, driver)
            if cls is None:
                continue
            found[path] = cls
            for name, message in argument_problems(cls, args):
                self._problem((*path, "args") if name is None else (*path, "args", name), message)
            if self._file.world is None and any(str(v).partition(".")[0] == "$world" for v in args.values()):
                self._problem((*path, "args"), "$world is named, but the station has no world")
        return found

    def _parts(self) -> list[tuple[_Path, str, dict[str, Any]]]:
        """Return place, class and arguments of all that is made, in the order in which it is made."""
        parts: list[tuple[_Path, str, dict[str, Any]]] = []
        if self._file.world is not None:
            parts.append((("world",), self._file.world.class_path, self._file.world.args))
        for role in ("clock", *_DEVICES):
            section = getattr(self._file.roles, role)
            parts.append((("roles", role), section.driver, section.args))
        return parts

    def _class(self, path: _Path, driver: str) -> type[Any] | None:
        key = (*path, "class" if path == ("world",) else "driver")
        try:
            cls = find_driver(driver)
        except DriverNotFound as error:
            self._problem(key, str(error))
            return None
        kind = _KINDS.get(path[-1])
        if kind is not None and not issubclass(cls, kind):
            self._problem(key, f"{driver} is no {kind.__name__}")
            return None
        if path[-1] == "clock" and not all(callable(getattr(cls, method, None)) for method in _CLOCK_METHODS):
            self._problem(key, f"{driver} is no clock: it needs {' and '.join(_CLOCK_METHODS)}")
            return None
        return cls

    def _made(self, classes: Mapping[_Path, type[Any]]) -> dict[str, Any]:
        """Return world, clock and devices by role."""
        made: dict[str, Any] = {}
        for path, _, args in self._parts():
            try:
                part = classes[path](**{name: self._value(value) for name, value in args.items()})
            except InputError as error:
                for problem in error.problems:
                    self._problem((*path, "args"), problem.message)
            except (DeviceError, TypeError, ValueError, AttributeError) as error:
                self._problem((*path, "args"), f"{classes[path].__name__} cannot be made of them: {error}")
            else:
                made[path[-1]] = part
                self._known[f"${path[-1]}"] = part
            if path[-1] in ("world", "clock"):  # what the others are made of
                self._stop_at_problems()
        return made

    def _value(self, value: Any) -> Any:
        if not isinstance(value, str) or not value.startswith("$"):
            return value
        part, _, name = value.partition(".")
        return getattr(self._known[part], name) if name else self._known[part]

    def _calibration(self, light: LightSource) -> Calibration:
        section = self._file.calibration
        return Calibration(
            clear_lux_per_level=section.light.clear_lux_per_level,
            levels=light.limits,
            filters={
                name: CalibratedFilter(f.nd_od, f.transmission, f.uncertainty) for name, f in section.filters.items()
            },
            bias_map=self._known["$bias_map"],
            light_uncertainty=section.light.uncertainty,
        )

    def _compare(self, light: LightSource, wheel: FilterWheel, camera: EventCamera) -> None:
        """Note where the devices are not those of the calibration."""
        calibration, sensor = self._file.calibration, self._file.sensor
        if light.limits.unit != calibration.light.unit:
            self._problem(
                ("calibration", "light", "unit"),
                f"{calibration.light.unit!r} is not the unit of {light.name}, which is {light.limits.unit!r}",
            )
        self._compare_filters(wheel)
        if (camera.width, camera.height) != (sensor.width, sensor.height):
            self._problem(
                ("sensor", "width"),
                f"{sensor.width} x {sensor.height} pixels, but {camera.name} has {camera.width} x {camera.height}",
            )
        for curve in self._known["$bias_map"].curves:
            if curve.bias not in camera.bias_limits:
                has = ", ".join(camera.bias_limits)
                self._problem(
                    ("calibration", "bias_map", curve.quantity, "bias"),
                    f"{camera.name} has no {curve.bias!r}; it has {has}",
                )

    def _compare_filters(self, wheel: FilterWheel) -> None:
        calibrated = self._file.calibration.filters
        there = {f.name: f.nd_od for f in wheel.filters}
        for name in there:
            if name not in calibrated:
                self._problem(("calibration", "filters"), f"filter {name!r} of {wheel.name} is not calibrated")
        for name, section in calibrated.items():
            if name not in there:
                self._problem(
                    ("calibration", "filters", name), f"{wheel.name} has no such filter; it has {', '.join(there)}"
                )
            elif section.nd_od != there[name]:
                self._problem(
                    ("calibration", "filters", name, "nd_od"),
                    f"{section.nd_od:g} is not the optical density that {wheel.name} has there, {there[name]:g}",
                )

    def _problem(self, path: _Path, message: str) -> None:
        line, column = _place(self._document, path)
        self._problems.append(Problem(f"{'.'.join(path)}: {message}", self._source, line, column))

    def _stop_at_problems(self) -> None:
        if self._problems:
            raise InputError(*sorted(self._problems, key=lambda problem: (problem.line, problem.column)))


def _place(document: Node, path: _Path) -> tuple[int, int]:
    """Return line and column of the key at the end of `path`, or of the last part of it that is in the file."""
    node, place = document, (document.line, document.column)
    for part in path:
        if part not in node.children:
            break
        place = node.key_places.get(part, place)
        node = node.children[part]
    return place


def bias_map_of(section: BiasMapSection) -> BiasMap:
    """Return the curves that a section of a station file describes."""
    sections = {quantity: getattr(section, quantity) for quantity in QUANTITIES}
    return BiasMap(
        tuple(
            BiasCurve(
                quantity=quantity,
                bias=curve.bias,
                scale=curve.scale,
                offsets=tuple(offset for offset, _ in curve.table),
                values=tuple(value for _, value in curve.table),
                calibrated=curve.calibrated,
            )
            for quantity, curve in sections.items()
            if curve is not None
        )
    )
