"""What a protocol asks the sensor to be, what it believes the sensor is, and how long it waits."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from protocols.base import Frequency, FrozenModel, Illuminance, LogThreshold, Seconds, WaitingTime, problems_at
from protocols.expected import Expected
from protocols.points import Roi, Settings, Settle

__all__ = ["Expect", "RoiChoice", "SettingsChoice", "SettleChoice", "Thresholds", "overlay"]

Pixel = Annotated[int, Field(strict=True, ge=0, le=65535)]
PixelCount = Annotated[int, Field(strict=True, ge=1, le=65536)]
BiasOffset = Annotated[int, Field(strict=True, ge=-255, le=255)]


class RoiChoice(FrozenModel):
    """A window of pixels, in sensor coordinates."""

    x: Pixel
    """First column."""
    y: Pixel
    """First row."""
    width: PixelCount
    """Number of columns."""
    height: PixelCount
    """Number of rows."""

    def to_roi(self) -> Roi:
        """Return the window as points carry it."""
        return Roi(self.x, self.y, self.width, self.height)


class Thresholds(FrozenModel):
    """Both thresholds, natural log units."""

    on: LogThreshold
    """ON threshold, ln units."""
    off: LogThreshold
    """OFF threshold, ln units."""


class Expect(FrozenModel):
    """What the sensor is believed to be: for checks, and for contrasts in units of the threshold.

    Thresholds, refractory period and bandwidth that the settings of a point prescribe go before these.
    """

    dark_light_lux: Illuminance
    """Equivalent dark illuminance: the light that would give the dark current, lux on chip."""
    theta_on: LogThreshold | None = None
    """ON threshold, ln units."""
    theta_off: LogThreshold | None = None
    """OFF threshold, ln units."""
    bandwidth_hz: Frequency | None = None
    """Corner of the source follower, Hz."""
    refractory_period_s: Seconds | None = None
    """Dead time after an event, s."""

    def to_expected(self) -> Expected:
        """Return the same as a plain dataclass."""
        return Expected(
            self.theta_on, self.theta_off, self.dark_light_lux, self.bandwidth_hz, self.refractory_period_s
        )


class SettingsChoice(FrozenModel):
    """What the sensor is asked to be, through the bias map of the station, and raw bias offsets."""

    long_refractory_period_s: Seconds | None = None
    """A dead time of several time constants of the pixel, s, so that its reference returns to the baseline."""
    imbalanced_thresholds: Thresholds | None = None
    """Thresholds of which one is deliberately lower than the other, ln units."""
    refractory_period_s: Seconds | None = None
    """The dead time where it is not meant to be long, s; in place of `long_refractory_period_s`."""
    thresholds: Thresholds | None = None
    """Thresholds that are not deliberately imbalanced, ln units; in place of `imbalanced_thresholds`."""
    bandwidth_hz: Frequency | None = None
    """Corner of the source follower, Hz."""
    biases: dict[str, BiasOffset] = Field(default_factory=dict)
    """Raw offsets from the factory codes, by bias name."""

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        found: list[tuple[tuple[str | int, ...], str]] = []
        if self.long_refractory_period_s is not None and self.refractory_period_s is not None:
            found.append((("refractory_period_s",), "is the same setting as long_refractory_period_s, give one"))
        if self.imbalanced_thresholds is not None and self.thresholds is not None:
            found.append((("thresholds",), "is the same setting as imbalanced_thresholds, give one"))
        pair = self.imbalanced_thresholds
        if pair is not None and pair.on == pair.off:
            found.append((("imbalanced_thresholds",), "on and off are equal; if that is meant, write thresholds"))
        if found:
            raise problems_at(found)
        return self

    def to_settings(self) -> Settings:
        """Return the settings as points carry them."""
        pair = self.imbalanced_thresholds or self.thresholds
        return Settings(
            theta_on=pair.on if pair else None,
            theta_off=pair.off if pair else None,
            refractory_s=self.long_refractory_period_s or self.refractory_period_s,
            bandwidth_hz=self.bandwidth_hz,
            biases=tuple(sorted(self.biases.items())),
        )


def overlay(base: Settings, over: Settings) -> Settings:
    """Return `base` with everything that `over` sets; raw biases are taken together, by name."""
    return Settings(
        theta_on=base.theta_on if over.theta_on is None else over.theta_on,
        theta_off=base.theta_off if over.theta_off is None else over.theta_off,
        refractory_s=base.refractory_s if over.refractory_s is None else over.refractory_s,
        bandwidth_hz=base.bandwidth_hz if over.bandwidth_hz is None else over.bandwidth_hz,
        biases=tuple(sorted((dict(base.biases) | dict(over.biases)).items())),
    )


class SettleChoice(FrozenModel):
    """How long to wait before a recording starts, s; what is left out is taken from the level above."""

    light_s: WaitingTime | None = None
    """After the light went to the first level of a point."""
    filter_s: WaitingTime | None = None
    """More, after the ND filter moved."""
    bias_s: WaitingTime | None = None
    """More, after a bias or the window changed."""

    def over(self, base: Settle) -> Settle:
        """Return `base` with everything that is given here."""
        return Settle(
            light_s=base.light_s if self.light_s is None else self.light_s,
            filter_s=base.filter_s if self.filter_s is None else self.filter_s,
            bias_s=base.bias_s if self.bias_s is None else self.bias_s,
        )
