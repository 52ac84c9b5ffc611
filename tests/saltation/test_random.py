"""The generator against Random123's known answers, its uniformity, and its independence of who asks when."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from basset._compile import compiled, digest_of
from saltation._random import philox, uniforms

KNOWN = [  # counter, key, answer: kat_vectors of Random123, philox4x32 with 10 rounds
    ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
]
LARGE = 2**32 + 5


def words(text):
    return tuple(np.uint64(int(word, 16)) for word in text.split())


def by_hand(counter, key):
    """Philox-4x32-10 in Python's integers, from the paper's definition of a round."""
    c, k = list(counter), list(key)
    for step in range(10):
        if step:
            k = [(k[0] + 0x9E3779B9) % 2**32, (k[1] + 0xBB67AE85) % 2**32]
        (high, low), (top, bottom) = divmod(0xD2511F53 * c[0], 2**32), divmod(0xCD9E8D57 * c[2], 2**32)
        c = [top ^ c[1] ^ k[0], bottom, high ^ c[3] ^ k[1], low]
    return c


@pytest.fixture(scope="module")
def table():
    """Numbers of 5000 impacts of one grain and seed."""
    return np.array([uniforms(11, 3, impact) for impact in range(5000)])


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN)
def test_known_answers(counter, key, answer):
    assert philox(words(counter), words(key)) == words(answer)


def test_the_paper_s_definition():
    rng = np.random.default_rng(1)
    for case in rng.integers(0, 2**32, (200, 6)).tolist():
        found = philox(tuple(map(np.uint64, case[:4])), tuple(map(np.uint64, case[4:])))
        assert [int(word) for word in found] == by_hand(case[:4], case[4:])


def test_where_seed_grain_and_impact_go():
    """Impact, then grain in the counter, the seed as key, each in two words of 32 bits; halfway between the words' steps."""
    for seed, grain, impact in ((0, 0, 0), (1, 2, 3), (LARGE, 7 * LARGE, 9 * LARGE)):
        counter = (impact % 2**32, impact >> 32, grain % 2**32, grain >> 32)
        expected = by_hand(counter, (seed % 2**32, seed >> 32))
        assert uniforms(seed, grain, impact) == tuple((word + 0.5) / 2**32 for word in expected)


def test_no_order_and_no_memory():
    places = [(seed, grain, impact) for seed in (0, 5) for grain in range(4) for impact in range(25)]
    forward = {place: uniforms(*place) for place in places}
    for place in reversed(places):
        assert uniforms(*place) == forward[place]


def test_every_seed_grain_and_impact_has_its_own_numbers():
    near = (0, 1, 2, 2**31, 2**32 - 1, 2**32, LARGE)
    draws = {uniforms(seed, grain, impact) for seed in near for grain in near for impact in near}
    assert len(draws) == len(near) ** 3
    assert len({number for draw in draws for number in draw}) > 4 * len(draws) - 3  # four numbers each, hardly ever equal


def test_uniform(table):
    """Chi-square over 64 bins for each of the four numbers, and Kolmogorov–Smirnov."""
    for column in table.T:
        counts = np.bincount((column * 64).astype(int), minlength=64)
        assert stats.chisquare(counts).pvalue > 0.01
        assert stats.kstest(column, "uniform").pvalue > 0.01
    assert 0.0 < table.min() < 1e-3
    assert 0.999 < table.max() < 1.0


def test_pairs_fill_the_square(table):
    """The four numbers of an impact among each other, and each with that of the impact before."""
    pairs = [(table[:, i], table[:, j]) for i in range(4) for j in range(i)] + [(table[1:, i], table[:-1, i]) for i in range(4)]
    for one, two in pairs:
        counts = np.bincount((one * 8).astype(int) * 8 + (two * 8).astype(int), minlength=64)
        assert stats.chisquare(counts).pvalue > 1e-3
        assert abs(np.corrcoef(one, two)[0, 1]) < 4.0 / np.sqrt(len(one))


@pytest.mark.parametrize("changed", ["seed", "grain"])
def test_neighbours_do_not_correlate(changed):
    draws = np.array([[uniforms(*((k, 3, i) if changed == "seed" else (3, k, i)))[0] for k in range(5)] for i in range(1000)])
    assert np.abs(np.corrcoef(draws.T) - np.eye(5)).max() < 4.0 / np.sqrt(1000)
    counts = np.bincount((draws * 32).astype(int).ravel(), minlength=32)
    assert stats.chisquare(counts).pvalue > 0.01


def test_a_negative_seed_is_refused():
    with pytest.raises(OverflowError):
        uniforms(-1, 0, 0)


def test_compiled_and_plain_draw_the_same_bits():
    sources = digest_of("saltation")

    @compiled()
    def table_of(seed, grain, impacts, out):
        sources  # part of the cache key
        for i in range(len(impacts)):
            out[i] = uniforms(seed, grain, impacts[i])

    impacts = np.array([0, 1, 2, 1000, 2**31, 2**32 - 1, LARGE, 2**53])
    found = np.empty((len(impacts), 4))
    for seed, grain in ((0, 0), (11, 3), (LARGE, LARGE), (2**62, 2**40)):
        table_of(seed, grain, impacts, found)
        assert np.array_equal(found, [uniforms(seed, grain, int(impact)) for impact in impacts])
