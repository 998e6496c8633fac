"""The characterization in a report: dark light, current and thresholds, each level, warnings and figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.report import characterization_captions as captions
from bench.report.characterization_tables import family_table, headlines, level_table
from bench.report.characterized import JSON_FILE, read_characterization
from bench.report.figures import bandwidth, level_thresholds, mismatch, noise_light, weber
from bench.report.showing import FIGURES, Picture, show, write_figures
from bench.report.wording import polarity_label

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from bench.report.characterization_tables import Headline
    from bench.report.characterized import SavedCharacterization, SavedFamily
    from bench.report.results_table import Table
    from bench.report.showing import Shown

__all__ = [
    "CharacterizationSection",
    "characterization_pictures",
    "characterization_section",
    "draw_characterization",
]


@dataclass(frozen=True, slots=True)
class CharacterizationSection:
    """What a page says of a characterization."""

    runs: tuple[str, ...]
    headlines: tuple[Headline, ...]
    families: Table | None
    levels: tuple[tuple[str, Table], ...]  #: title and table of each family
    notes: tuple[str, ...]  #: why a family has no fit
    warnings: tuple[str, ...]
    figures: tuple[Shown, ...]


def characterization_section(folder: Path, figures: Path) -> CharacterizationSection | None:
    """Return the section about the characterization in `folder`, or None where there is none.

    Parameters
    ----------
    folder
        Where `evs-bench characterize` wrote its results.
    figures
        Where the figures are written; their names begin with ``characterization_``.

    Raises
    ------
    InputError
        The files cannot be read as a characterization.
    """
    if not (folder / JSON_FILE).exists():
        return None
    found = read_characterization(folder)
    shown = show(characterization_pictures(found), figures)
    return CharacterizationSection(
        runs=found.runs,
        headlines=headlines(found),
        families=family_table([f for _, families in found.groups() for f in families]),
        levels=tuple(_levels(found)),
        notes=tuple(_notes(found)),
        warnings=tuple(dict.fromkeys((*found.warnings, *(w for f in found.families for w in f.warnings)))),
        figures=shown,
    )


def draw_characterization(folder: Path) -> tuple[Path, ...]:
    """Draw the figures of the characterization in `folder` into its folder ``figures``, as PNG and PDF.

    Returns
    -------
    tuple of Path
        The files, in the order of the figures.

    Raises
    ------
    InputError
        There is no characterization, or it cannot be read.
    """
    return write_figures(characterization_pictures(read_characterization(folder)), folder / FIGURES)


def characterization_pictures(found: SavedCharacterization) -> Iterator[Picture]:
    """Yield the figures of a characterization that make sense, most important first."""
    yield from _family_pictures(found)
    yield from _noise_pictures(found)
    yield from _mismatch_picture(found)


def _family_pictures(found: SavedCharacterization) -> Iterator[Picture]:
    groups = found.groups()
    for number, (title, families) in enumerate(groups, start=1):
        yield from _pictures_of(families, *((f"_{number}", f": {title}") if len(groups) > 1 else ("", "")))


def _pictures_of(families: Sequence[SavedFamily], suffix: str, which: str) -> Iterator[Picture]:
    lines = weber.prepare(families)
    if lines is not None:
        yield Picture(
            f"characterization_weber{suffix}", f"Dark light from the contrast needed{which}",
            captions.weber(lines), lambda: weber.draw(lines),
        )  # fmt: skip
    levels = level_thresholds.prepare(families)
    if levels is not None:
        yield Picture(
            f"characterization_thresholds{suffix}", f"Threshold with dark light accounted for{which}",
            captions.level_thresholds(levels), lambda: level_thresholds.draw(levels),
        )  # fmt: skip
    corners = bandwidth.prepare(families)
    if corners is not None:
        yield Picture(
            f"characterization_bandwidth{suffix}", f"Bandwidth against light{which}",
            captions.bandwidth(corners), lambda: bandwidth.draw(corners),
        )  # fmt: skip


def _noise_pictures(found: SavedCharacterization) -> Iterator[Picture]:
    settings = list(dict.fromkeys(n.settings for n in found.noise))
    for number, label in enumerate(settings, start=1):
        levels = [n for n in found.noise if n.settings == label]
        suffix, which = (f"_{number}", f": {label}") if len(settings) > 1 else ("", "")
        yield from _noise_picture(noise_light.prepare(levels, found.families), suffix, which)


def _noise_picture(numbers: noise_light.NoiseLightNumbers | None, suffix: str, which: str) -> Iterator[Picture]:
    if numbers is not None:
        yield Picture(
            f"characterization_noise{suffix}", f"Background activity and noise against light{which}",
            captions.noise_light(numbers), lambda: noise_light.draw(numbers),
        )  # fmt: skip


def _mismatch_picture(found: SavedCharacterization) -> Iterator[Picture]:
    maps = mismatch.prepare(found.mismatch)
    if maps is not None:
        yield Picture(
            "characterization_mismatch", "Mismatch of the pixels", captions.mismatch(maps),
            lambda: mismatch.draw(maps),
        )  # fmt: skip


def _levels(found: SavedCharacterization) -> Iterator[tuple[str, Table]]:
    for title, families in found.groups():
        for family in families:
            yield f"{polarity_label(family.polarity)}, {title}", level_table(family)


def _notes(found: SavedCharacterization) -> Iterator[str]:
    """Yield why families have no fit, each reason once."""
    reasons: dict[str, list[str]] = {}
    for title, families in found.groups():
        for family in families:
            if not family.fit:
                reasons.setdefault(family.why_no_fit, []).append(f"{polarity_label(family.polarity)}, {title}")
    for reason, names in reasons.items():
        yield f"No fit of a noisy pixel to {'; '.join(names)}: {reason}."
