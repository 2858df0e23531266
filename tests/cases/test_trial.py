"""A trial shows itself in a notebook and as a table."""

from __future__ import annotations

import numpy as np

from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial


def test_a_trial_is_a_table_with_the_headers_of_a_trial_file():
    trial = Trial("a<b", {"t": np.arange(3.0), "u": np.array([1.0, np.nan, 3.0]), "n_3": np.zeros(3)})
    assert list(trial.to_pandas()) == ["t [s]", "u [m/s]", "n_3 [rps]"]
    page = trial._repr_html_()
    assert "a&lt;b" in page and "u [m/s]" in page and "<td>2</td>" in page


def test_a_ship_is_a_table_of_its_coefficients():
    ship = load_ship("esso_osaka_3m")
    table = ship.to_pandas()
    assert table.loc["Y_v", "value"] == ship.coefficients["Y_v"].value and tuple(table.index) == ship.symbols
    assert "esso_osaka_3m" in ship._repr_html_() and "Y_v" in ship._repr_html_()


def test_the_rudder_of_a_trial_is_its_own_the_mean_of_two_or_none():
    t = np.arange(3.0)
    columns = {"t": t, "delta_port": 0.2 * t, "delta_starboard": 0.4 * t}
    np.testing.assert_allclose(Trial("twin", columns).rudder, 0.3 * t)
    np.testing.assert_array_equal(Trial("single", {**columns, "delta": t}).rudder, t)
    np.testing.assert_array_equal(Trial("azimuth", {"t": t}).rudder, np.zeros(3))
