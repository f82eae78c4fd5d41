"""Probabilities of causes: they are a distribution, and follow evidence, price and what is left as one would bet."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.diagnosis.probability import NOTHING, UNKNOWN, WEAK, Left, combined, posterior, weight
from twin_daemon.diagnosis.thresholds import DECISIVE_NATS, LEAST_PROBABILITY, SURE, TOO_WEAK, UNKNOWN_PRIOR_ABOVE

NATS = st.dictionaries(st.sampled_from(["backlash:a", "spring:a", "payload:b"]), st.floats(-1e6, 1e6), min_size=1)


@given(NATS, st.floats(1.0, 1e4))
def test_probabilities_of_one_place_are_a_distribution(nats: dict[str, float], decisive: float) -> None:
    found = posterior(nats, decisive)
    assert sum(found.values()) == pytest.approx(1.0)
    assert set(found) == {*nats, NOTHING}
    ranked = sorted(nats, key=nats.__getitem__)
    assert [found[name] for name in ranked] == sorted(found[name] for name in ranked)


@given(st.lists(NATS, max_size=3), st.lists(st.floats(0.0, 1.0), max_size=3))
def test_sets_of_causes_are_a_distribution_without_what_is_negligible(
    places: list[dict[str, float]], unknowns: list[float]
) -> None:
    found = combined([posterior(nats, DECISIVE_NATS) for nats in places], unknowns)
    shares = [one.probability for one in found]
    assert sum(shares) <= 1.0 + 1e-9
    assert shares == sorted(shares, reverse=True)
    assert all(share > LEAST_PROBABILITY for share in shares)
    assert len({one.effects for one in found}) == len(found)


def test_who_is_decisively_behind_leaves_the_best_sure() -> None:
    found = posterior({"backlash:a": 500.0, "spring:a": 500.0 - DECISIVE_NATS}, DECISIVE_NATS)
    assert found["backlash:a"] == pytest.approx(SURE, abs=1e-3)


@given(st.floats(5.0, 1e4), st.floats(0.0, 50.0))
def test_what_a_prior_says_counts_for_what_it_is_however_much_is_left(decisive: float, nats: float) -> None:
    # the data say as much of both; without the weak servo its gain would have to be that far from its nominal value
    weak = weight(1000.0 + 2.0 * nats, 1000.0, 2.0 * nats, 0.0, 0.0, decisive)
    other = weight(1000.0 + 2.0 * nats, 1000.0 + 2.0 * nats, 2.0 * nats, 2.0 * nats, 0.0, decisive)
    found = posterior({"actuator_gain:a": weak, "payload:a": other}, decisive)
    odds = found["actuator_gain:a"] / max(found["payload:a"], 1e-300)
    assert odds == pytest.approx(math.exp(nats), rel=1e-6)


def test_what_the_data_say_counts_less_the_more_is_left() -> None:
    sure, doubtful = (
        posterior({"a": weight(1000.0, 960.0, 0.0, 0.0, 0.0, decisive), "b": 0.0}, decisive)["a"]
        for decisive in (5.0, 100.0)
    )
    assert sure > 0.99 > doubtful


def test_the_number_of_candidates_is_paid_for() -> None:
    few, many = (posterior({f"e{i}:a": 3.0 if i == 0 else -90.0 for i in range(n)}, 5.0) for n in (1, 20))
    assert many[NOTHING] > few[NOTHING]


def test_a_law_of_no_library_is_as_probable_as_what_is_left_says() -> None:
    found = [Left(adequacy, above=True, named=True).unknown() for adequacy in (0.1, 1.0, 1.5, 2.0, 5.0)]
    assert found == sorted(found)
    assert found[0] < 0.02
    assert found[1] == pytest.approx(UNKNOWN_PRIOR_ABOVE)
    assert found[-1] > 0.9
    assert Left(1e30, above=False, named=False).unknown() == pytest.approx(1.0)


def test_where_nothing_could_be_named_a_law_of_no_library_is_more_probable() -> None:
    assert Left(1.5, above=True, named=False).unknown() > Left(1.5, above=True, named=True).unknown()
    assert Left(1.1, above=True, named=False).unknown() > 0.5


def test_many_causes_are_less_probable_than_one_law_that_looks_like_all_of_them() -> None:
    found = [1.0 - Left(0.2, above=True, named=True).unknown(causes) for causes in (1, 2, 3)]
    assert found == sorted(found, reverse=True)
    assert found[1] > SURE > found[2]


def test_nothing_is_missing_leaves_room_for_what_is_too_weak() -> None:
    found = {one.effects: one.probability for one in combined([], [0.0])}
    assert found == {(NOTHING,): pytest.approx(1.0 - TOO_WEAK), (WEAK,): pytest.approx(TOO_WEAK)}


def test_two_places_and_a_doubt_are_multiplied() -> None:
    found = combined([{"backlash:a": 0.9, NOTHING: 0.1}, {"spring:b": 1.0}], [0.2])
    assert {one.effects: round(one.probability, 3) for one in found} == {
        ("backlash:a", "spring:b"): 0.72,
        (UNKNOWN,): 0.2,
        ("spring:b",): 0.08,
    }


def test_words_are_those_of_a_bet() -> None:
    found = combined([{"backlash:FFJ3": 0.97, "tendon_elasticity:FFJ3": 0.03}], [0.0])
    assert list(map(str, found)) == ["backlash at FFJ3: 97 in 100", "tendon_elasticity at FFJ3: 3 in 100"]
    assert str(combined([], [0.001])[0]) == f"nothing is missing: {100 * (1 - TOO_WEAK):.0f} in 100"
