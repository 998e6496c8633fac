"""`evs-bench photometry`: from lens data, spectra and stated currents to lux, photons and quantum efficiency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from bench.commands.common import json_option, print_json, print_table
from bench.commands.metering import meter
from bench.commands.numbers import ABOVE_0, FRACTION, FROM_0

if TYPE_CHECKING:
    from bench.photometry.claims import Implied, Pair
    from bench.photometry.spectrum import Efficiency, PerLux, Spectrum
    from bench.station.schema import BareGeometry, LensGeometry

__all__ = ["command"]

_FORMAT = "evs-bench-photometry/1"

_transmission_option = click.option(
    "--transmission", type=FRACTION, metavar="T", help="Of a filter in the path: measured, not 10^-OD."
)


@click.group(name="photometry")
def command() -> None:
    """Turn meter readings, lens data or a spectrum into lux and photons on the chip."""


command.add_command(meter)


@command.command()
@click.option("--f-number", type=ABOVE_0, required=True, metavar="N", help="Of the lens, set to infinity.")
@click.option("--transmittance", type=FRACTION, required=True, metavar="T", help="Of the lens.")
@click.option("--magnification", type=FROM_0, default=0.0, show_default=True, metavar="M",
              help="Size of the image over that of the object; 0 is far away.")  # fmt: skip
@click.option("--luminance", type=FROM_0, metavar="L", help="Of the scene, cd/m2.")
@click.option("--scene-lux", type=FROM_0, metavar="E", help="Illuminance of a matt scene, lux, instead.")
@click.option("--reflectance", type=FRACTION, metavar="R", help="Of that scene.")
@_transmission_option
@json_option
def lens(
    f_number: float,
    transmittance: float,
    magnification: float,
    luminance: float | None,
    scene_lux: float | None,
    reflectance: float | None,
    transmission: float | None,
    as_json: bool,
) -> None:
    """Print the lux on a chip behind a lens, on its axis: E = pi L T / (4 N^2 (1 + m)^2).

    A matt (Lambertian) scene has the luminance L = E R / pi.
    """
    import math

    from bench.station.schema import LensGeometry

    if (luminance is None) == (scene_lux is None) or (scene_lux is None) != (reflectance is None):
        raise click.UsageError("give the scene either by --luminance, or by --scene-lux and --reflectance")
    if luminance is None:
        luminance = (scene_lux or 0.0) * (reflectance or 0.0) / math.pi
    geometry = LensGeometry(kind="lens", f_number=f_number, transmittance=transmittance, magnification=magnification)
    asked = {"scene_lux": scene_lux, "reflectance": reflectance}
    _print_chip_lux("lens", geometry, luminance, transmission, asked, as_json)


@command.command()
@click.option("--distance-mm", type=FROM_0, required=True, metavar="D", help="From the port to the chip.")
@click.option("--port-radius-mm", type=ABOVE_0, required=True, metavar="R", help="Of the luminous disc.")
@click.option("--luminance", type=FROM_0, required=True, metavar="L", help="Of the disc, cd/m2.")
@_transmission_option
@json_option
def bare(
    distance_mm: float, port_radius_mm: float, luminance: float, transmission: float | None, as_json: bool
) -> None:
    """Print the lux on a bare chip on the axis of a luminous disc: E = pi L R^2 / (R^2 + D^2)."""
    from bench.station.schema import BareGeometry

    geometry = BareGeometry(kind="bare", distance_mm=distance_mm, port_radius_mm=port_radius_mm)
    _print_chip_lux("bare", geometry, luminance, transmission, {}, as_json)


def _print_chip_lux(
    name: str,
    geometry: BareGeometry | LensGeometry,
    luminance: float,
    transmission: float | None,
    asked: dict[str, Any],
    as_json: bool,
) -> None:
    clear_lux = geometry.lux_per_luminance * luminance
    lux = clear_lux * (1.0 if transmission is None else transmission)
    if as_json:
        asked = {**geometry.model_dump(exclude={"kind"}), **asked, "transmission": transmission}
        numbers = {"luminance": luminance, "lux_per_luminance": geometry.lux_per_luminance, "lux": lux}
        print_json({"format": _FORMAT, "command": name, "asked": asked, **numbers})
        return
    click.echo(f"luminance      {luminance:.6g} cd/m2")
    click.echo(f"lux per cd/m2  {geometry.lux_per_luminance:.4g}")
    if transmission is not None:
        click.echo(f"no filter      {clear_lux:.4g} lux")
        click.echo(f"transmission   {transmission:.4g}")
    click.echo(f"on the chip    {lux:.4g} lux")


@command.command()
@click.argument("name", nargs=-1)
@click.option("--qe", metavar="Q|FILE", help="Quantum efficiency: a number, or a CSV file wavelength_nm,qe.")
@click.option("--pitch-um", type=ABOVE_0, metavar="P", help="Distance of two pixels, um; with --qe.")
@click.option("--range", "range_nm", type=ABOVE_0, nargs=2, default=(400.0, 700.0), show_default=True,
              metavar="LOW HIGH", help="Wavelengths whose photons count, nm.")  # fmt: skip
@click.option("--list", "listing", is_flag=True, help="List the names of the standard spectra.")
@json_option
def spectrum(
    name: tuple[str, ...],
    qe: str | None,
    pitch_um: float | None,
    range_nm: tuple[float, float],
    listing: bool,
    as_json: bool,
) -> None:
    """Print how many photons a lux of the spectrum NAME is, and what a sensor makes of them.

    NAME is a standard spectrum (A, D65, E, LED-B3), `blackbody 5800`, `mono 525`, or a file that ends in .csv with
    the header wavelength_nm,power (power per nm, in any unit).
    """
    if listing:
        _print_names(as_json)
        return
    if not name:
        raise click.UsageError("name a spectrum or a file, or ask for --list")
    if pitch_um is not None and qe is None:
        raise click.UsageError("--pitch-um needs --qe: without it there is no current")
    if not range_nm[0] < range_nm[1]:
        raise click.UsageError(f"--range: expected LOW below HIGH, found {range_nm[0]:g} {range_nm[1]:g}")
    from bench.photometry.cie import luminosity
    from bench.photometry.spectrum import per_lux

    light, efficiency = _spectrum(" ".join(name)), _efficiency(qe, range_nm)
    found = per_lux(light, luminosity(), range_nm, efficiency)
    current_fa = _current_per_lux(found, pitch_um)
    if as_json:
        asked = {"spectrum": " ".join(name), "qe": qe, "pitch_um": pitch_um, "range_nm": range_nm}
        numbers = {
            "photons_per_lux": found.photons_per_lux,
            "efficacy_lm_w": found.efficacy_lm_w,
            "quantum_efficiency": found.eta,
            "current_fa_per_lux": current_fa,
            "photons_outside_range": found.outside,
            "cut_off_nm": found.cut_off_nm,
        }
        print_json({"format": _FORMAT, "command": "spectrum", "asked": asked, "spectrum": light.name, **numbers})
        return
    _print_spectrum(light, found, range_nm, current_fa)


def _print_names(as_json: bool) -> None:
    from bench.photometry.cie import names

    if as_json:
        print_json({"format": _FORMAT, "command": "spectrum", "names": names()})
        return
    click.echo("\n".join([*names(), "blackbody KELVIN", "mono NANOMETRES"]))


def _spectrum(name: str) -> Spectrum:
    from bench.photometry.cie import spectrum_named
    from bench.photometry.spectrum import read_spectrum

    return read_spectrum(name) if name.lower().endswith(".csv") else spectrum_named(name)


def _efficiency(text: str | None, range_nm: tuple[float, float]) -> Efficiency | None:
    """Return a quantum efficiency that is given as a number or as a file."""
    from bench.photometry.csv_tables import plain_number
    from bench.photometry.spectrum import constant_efficiency, read_efficiency

    if text is None:
        return None
    value = plain_number(text)
    if value is None:
        return read_efficiency(text)
    if not 0.0 < value <= 1.0:
        raise click.BadParameter(f"expected a number above 0 and up to 1, found {text}", param_hint="--qe")
    return constant_efficiency(value, range_nm)


def _current_per_lux(found: PerLux, pitch_um: float | None) -> float | None:
    from bench.photometry.current import Photodiode
    from bench.photometry.propagation import Known

    if found.eta is None or pitch_um is None:
        return None
    return Photodiode(Known(found.eta), Known(pitch_um * 1e-6), Known(found.photons_per_lux)).fa_per_lux


def _print_spectrum(light: Spectrum, found: PerLux, range_nm: tuple[float, float], current_fa: float | None) -> None:
    low, high = range_nm
    click.echo(f"spectrum             {light.name}, photons of {low:g} to {high:g} nm")
    click.echo(f"photons per lux      {found.photons_per_lux:.4g} per m2 and s")
    click.echo(f"luminous efficacy    {found.efficacy_lm_w:.4g} lm/W")
    if found.eta is not None:
        click.echo(f"quantum efficiency   {found.eta:.4g} (mean over these photons)")
    if current_fa is not None:
        click.echo(f"photocurrent         {current_fa:.4g} fA per lux and pixel")
    if found.outside > 0.01:
        first, last = light.wavelength_nm[[0, -1]]
        click.echo(f"not counted          {found.outside:.0%} of its photons of {first:g} to {last:g} nm")
    for end in found.cut_off_nm:
        click.echo(f"warning: the spectrum ends at {end:g} nm, where the eye still sees much of it: too few lux")


@command.command()
@click.argument("claims", nargs=-1, required=True, metavar="CLAIM...")
@click.option("--pitch-um", type=ABOVE_0, required=True, metavar="P", help="Distance of two pixels, um.")
@click.option("--photons-per-lux", type=ABOVE_0, required=True, metavar="N",
              help="Per m2 and s; a daylight-like white has 1.12e16 of 400 to 700 nm.")  # fmt: skip
@json_option
def efficiency(claims: tuple[str, ...], pitch_um: float, photons_per_lux: float, as_json: bool) -> None:
    """Print the quantum efficiency that stated dark currents imply, and whether it is one and the same.

    A CLAIM is FA[+-SD],LUX,LOG_CONTRAST,THETA: a dark current with its standard error, and the light on the chip and
    the smallest step that it was derived from, at an ON threshold in ln units: 5.55+-0.28,0.076,0.8,0.35. A contrast
    in per cent is a linear one: 100% is ln 2. Light, contrast and threshold count as exact.
    """
    from bench.photometry.claims import implied, pairs, parse_claim

    found = [implied(claim, pitch_um * 1e-6, photons_per_lux) for claim in map(parse_claim, claims)]
    compared = pairs(found)
    if as_json:
        asked = {"claims": claims, "pitch_um": pitch_um, "photons_per_lux": photons_per_lux}
        numbers = {"claims": [_claim_dict(one) for one in found], "pairs": [_pair_dict(pair) for pair in compared]}
        print_json({"format": _FORMAT, "command": "efficiency", "asked": asked, **numbers})
        return
    header = ("claim", "stated fA", "dark light mlux", "fA per eta", "eta", "")
    print_table(header, [_claim_row(i, one) for i, one in enumerate(found, start=1)])
    for pair in compared:
        click.echo(_pair_line(pair, found))


def _claim_row(number: int, one: Implied) -> tuple[str, ...]:
    claim = one.claim
    stated = f"{claim.current_fa:g}" + ("" if claim.sd_fa is None else f" +- {claim.sd_fa:g}")
    eta = f"{one.eta:.3f}" + ("" if one.eta_sd is None else f" +- {one.eta_sd:.3f}")
    impossible = "above 1: the current does not belong to this light" if one.eta > 1.0 else ""
    return str(number), stated, f"{1e3 * one.dark_lux:.1f}", f"{one.fa_per_eta:.3f}", eta, impossible


def _pair_line(pair: Pair, found: list[Implied]) -> str:
    stated = [found[i].eta_sd is not None for i in (pair.first, pair.second)]
    reasons = [*(["two standard errors"] if any(stated) else []), *([] if all(stated) else ["rounding"])]
    verdict = "may follow from one eta" if pair.one_eta else "do not follow from one eta"
    return (
        f"claims {pair.first + 1} and {pair.second + 1} {verdict}: these differ by {pair.difference:.1%} "
        f"of their mean, and {' and '.join(reasons)} may explain {pair.allowed:.1%}"
    )


def _claim_dict(one: Implied) -> dict[str, Any]:
    return {
        "claim": one.claim.text,
        "current_fa": one.claim.current_fa,
        "current_sd_fa": one.claim.sd_fa,
        "lux": one.claim.lux,
        "log_contrast": one.claim.log_contrast,
        "theta": one.claim.theta,
        "dark_light_lux": one.dark_lux,
        "current_fa_per_eta": one.fa_per_eta,
        "eta": one.eta,
        "eta_sd": one.eta_sd,
        "possible": one.eta <= 1.0,
    }


def _pair_dict(pair: Pair) -> dict[str, Any]:
    return {
        "claims": [pair.first + 1, pair.second + 1],
        "difference": pair.difference,
        "allowed": pair.allowed,
        "one_eta": pair.one_eta,
    }
