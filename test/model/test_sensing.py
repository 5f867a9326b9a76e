"""Sensors: how late, how noisy, and independent of each other."""

import numpy as np

from cacc_platoon.model import Sensing, Sensor

N = 1_000_000


def errors(**changes):
    values = {"delay": 0, "range_std": 0.3, "range_rate_std": 0.1, "seed": 1, "vehicle": 1}
    return Sensing(**{**values, **changes}).errors()


def test_errors_have_their_deviation_and_are_independent():
    ranges, rates = (draw(0, N) for draw in errors())
    for found, std in ((ranges, 0.3), (rates, 0.1)):
        assert abs(found.mean()) < 4.0 * std / np.sqrt(N)
        assert abs(found.std() - std) < 4.0 * std / np.sqrt(2.0 * N)
    others = [draw(0, N) for change in ({"seed": 2}, {"vehicle": 2}) for draw in errors(**change)]
    for other in (rates, *others):
        assert abs(np.corrcoef(ranges, other)[0, 1]) < 4.0 / np.sqrt(N)


def test_a_slice_is_that_of_the_whole():
    draw, _ = errors()
    np.testing.assert_array_equal(draw(0, 20_000)[8000:9000], errors()[0](8000, 9000))


def test_late_measurements_are_those_of_then_from_where_it_is_now():
    sensor = Sensor(Sensing(3, 0.0, 0.0, seed=1, vehicle=1))
    own = [(2.0 * k, 20.0 + k) for k in range(10)]
    ahead = [(30.0 + 3.0 * k, 25.0 - k) for k in range(10)]
    for k in range(10):
        then = max(k - 3, 0)
        position, velocity = sensor.ahead(own[k], ahead[k])
        assert position == own[k][0] + (ahead[then][0] - own[then][0])
        assert velocity == own[k][1] + (ahead[then][1] - own[then][1])


def test_a_perfect_sensor_is_called_so():
    assert Sensing(0, 0.0, 0.0, 1, 1).perfect
    assert not any(
        Sensing(*bad, 1, 1).perfect for bad in ((1, 0.0, 0.0), (0, 0.1, 0.0), (0, 0.0, 0.1))
    )
