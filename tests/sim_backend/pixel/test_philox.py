"""The counter-based generator: known answers, and the normal numbers made of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from sim_backend.pixel.engines import reference_kernels
from sim_backend.pixel.philox import normals, philox4x32, split_seed

kernels: Any = reference_kernels

# Known answers of the Random123 distribution for philox4x32, 10 rounds: counter, key, words.
KNOWN = [
    ((0,) * 4, (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF, 0xFFFFFFFF), (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@pytest.mark.parametrize(("counter", "key", "words"), KNOWN)
def test_known_answers_in_numpy(counter: tuple[int, ...], key: tuple[int, int], words: Any) -> None:
    assert tuple(philox4x32(np.array([counter], np.uint32), key)[0]) == words


@pytest.mark.parametrize(("counter", "key", "words"), KNOWN)
def test_known_answers_compiled(counter: tuple[int, ...], key: tuple[int, int], words: Any) -> None:
    assert kernels.philox4x32(*(np.uint32(v) for v in (*counter, *key))) == words


def noise(blocks: int, seed: int) -> npt.NDArray[np.float64]:
    """Return (blocks, 4, LANES) normal numbers as the engine draws them."""
    words = np.empty(4 * kernels.LANES, np.uint32)
    z = np.empty(4 * kernels.LANES, np.float32)
    pixel = np.arange(kernels.LANES, dtype=np.uint32)
    key = tuple(np.uint32(w) for w in split_seed(seed))
    out = np.empty((blocks, 4, kernels.LANES))
    for i in range(blocks):
        kernels.fill_words(i, pixel, *key, words)
        kernels.fill_normals(words, z)
        out[i] = z.reshape(4, kernels.LANES)
    return out


def test_the_lanes_use_the_words_of_their_address() -> None:
    words = np.empty(4 * kernels.LANES, np.uint32)
    pixel = np.arange(kernels.LANES, dtype=np.uint32) * np.uint32(65537)
    index = (3 << 32) + 7
    kernels.fill_words(index, pixel, np.uint32(5), np.uint32(6), words)
    counter = np.zeros((kernels.LANES, 4), np.uint32)
    counter[:, 0], counter[:, 1], counter[:, 2], counter[:, 3] = 7, pixel, kernels.PURPOSE_NOISE, 3
    assert np.array_equal(words.reshape(4, -1).T, philox4x32(counter, (5, 6)))


def test_moments_tails_and_independence_of_the_noise() -> None:
    z = noise(8_000, seed=11)
    n = z.size
    moments = ((z, 0.0, 1.0), (z * z, 1.0, 2.0), (z * z * z, 0.0, 15.0), (z * z * z * z, 3.0, 96.0))
    for power, expected, variance in moments:
        assert np.mean(power) == pytest.approx(expected, abs=4 * np.sqrt(variance / n))
    for limit in (3.0, 4.0, 4.5):
        expected = 2 * stats.norm.sf(limit) * n
        assert np.sum(np.abs(z) > limit) == pytest.approx(expected, abs=4 * np.sqrt(expected))
    assert stats.kstest(z.ravel()[::7], "norm").pvalue > 1e-3
    in_time = z.transpose(2, 0, 1).reshape(kernels.LANES, -1)
    for lag in range(1, 6):
        assert abs(np.mean(in_time[:, lag:] * in_time[:, :-lag])) < 4 / np.sqrt(n)
        # The sign of a Box-Muller pair and its radius must not leak either.
        assert abs(np.mean(in_time[:, lag:] ** 2 * in_time[:, :-lag] ** 2) - 1.0) < 4 * np.sqrt(8 / n)
    assert abs(np.mean(z[..., 1:] * z[..., :-1])) < 4 / np.sqrt(n)


def test_the_largest_words_give_finite_numbers() -> None:
    extremes = [0, 1, 0x3FFFFFFF, 0x40000000, 0x7FFFFFFF, 0x80000000, 0xBFFFFFFF, 0xC0000000, 0xFFFFFFFF]
    for a in extremes:
        for b in extremes:
            x, y = kernels.normal_pair(np.uint32(a), np.uint32(b))
            assert np.isfinite(x)
            assert np.isfinite(y)
            assert np.hypot(x, y) < 6.7


def test_angles_cover_the_circle_evenly() -> None:
    z = noise(5_000, seed=3)
    angle = np.arctan2(z[:, 1], z[:, 0]).ravel()
    found = np.histogram(angle, 64, (-np.pi, np.pi))[0]
    assert stats.chisquare(found).pvalue > 1e-3


def test_logarithms() -> None:
    x = np.concatenate([10.0 ** np.linspace(-12, 12, 4001), np.nextafter([1.0, 1.0, 2.0**0.5], [0, 2, 2])])
    ours = np.array([kernels.ln_f64(v) for v in x])
    assert np.max(np.abs(ours - np.log(x)) / np.maximum(np.abs(np.log(x)), 1.0)) < 1e-15
    u = np.linspace(2.0**-32, 1.0, 20_001).astype(np.float32)
    ours_f32 = np.array([kernels.ln_f32(v) for v in u], np.float64)
    assert np.max(np.abs(ours_f32 - np.log(u.astype(np.float64)))) < 2e-6


def test_sine_and_cosine() -> None:
    x = np.linspace(-np.pi / 4, np.pi / 4, 4001).astype(np.float32)
    assert np.max(np.abs([kernels.sine_f32(v) - np.sin(np.float64(v)) for v in x])) < 2e-7
    assert np.max(np.abs([kernels.cosine_f32(v) - np.cos(np.float64(v)) for v in x])) < 2e-7


def test_frozen_draws_are_normal_and_each_purpose_has_its_own() -> None:
    index = np.arange(200_000, dtype=np.uint32)
    a, b = normals(5, index, 1), normals(5, index, 2)
    assert stats.kstest(a, "norm").pvalue > 1e-3
    assert abs(np.corrcoef(a, b)[0, 1]) < 4 / np.sqrt(len(index))
    assert abs(np.corrcoef(a[1:], a[:-1])[0, 1]) < 4 / np.sqrt(len(index))
    assert np.array_equal(normals(5, index[1000:1010], 1), a[1000:1010])
    assert not np.array_equal(normals(6, index, 1), a)


@pytest.mark.parametrize("seed", [-1, 1 << 64])
def test_a_seed_that_is_no_64_bit_number_is_refused(seed: int) -> None:
    with pytest.raises(ValueError, match="0 to 2"):
        split_seed(seed)
