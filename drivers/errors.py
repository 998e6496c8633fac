"""What can go wrong with an instrument: one small tree.

Every message says which device, what was asked of it, what came back, and what to try.
"""

from __future__ import annotations

__all__ = [
    "ConnectionFailed",
    "DataLost",
    "DeviceError",
    "DeviceTimeout",
    "OutOfRange",
    "UnexpectedAnswer",
    "Unsupported",
    "WrongState",
]


class DeviceError(Exception):
    """A device did not do what it was asked to do.

    Parameters
    ----------
    device
        Name of the device, as the operator knows it.
    asked
        What was asked of it.
    answered
        What came back, or what was seen instead.
    advice
        What to try.
    """

    def __init__(self, device: str, asked: str, answered: str, advice: str = "") -> None:
        self.device = device
        self.asked = asked
        self.answered = answered
        self.advice = advice
        text = f"{device}: {asked}: {answered}"
        super().__init__(f"{text}; {advice}" if advice else text)


class ConnectionFailed(DeviceError):
    """The device is not there, is in use, or is not the one that was expected."""


class DeviceTimeout(DeviceError):
    """No answer, or not the whole of it, in time."""


class UnexpectedAnswer(DeviceError):
    """The device answered, but not in its own language."""


class WrongState(DeviceError):
    """The request makes no sense now (not connected, already recording)."""


class Unsupported(DeviceError):
    """The device cannot do this at all."""


class DataLost(DeviceError):
    """Events or bytes are known to be missing."""


class OutOfRange(DeviceError):
    """A value outside the device's limits; nothing was changed.

    Parameters
    ----------
    device, quantity
        Whose limit, and of what.
    value, lowest, highest
        The value asked for and the range it must be in.
    unit
        Unit of the three.
    """

    def __init__(self, device: str, quantity: str, value: float, lowest: float, highest: float, unit: str) -> None:
        self.quantity = quantity
        self.value = value
        self.lowest = lowest
        self.highest = highest
        self.unit = unit
        super().__init__(
            device,
            f"set {quantity} to {value:g} {unit}",
            f"allowed is {lowest:g} to {highest:g} {unit}",
        )
