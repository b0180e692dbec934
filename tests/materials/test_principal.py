"""Principal components that are the same whatever library computed them."""

from __future__ import annotations

import numpy as np

from burnish.materials.principal import leading, same_signs


def test_vectors_point_where_they_do_whatever_signs_they_came_with() -> None:
    rng = np.random.default_rng(0)
    vectors = np.linalg.qr(rng.standard_normal((9, 4)))[0]
    # One whose largest entries are alike but for rounding, in which libraries differ too
    vectors[:, 0] = np.array([0, -1, 0, 1, 0, 1, 0, 0, -1]) / 2
    expected = same_signs(vectors)
    assert expected[1, 0] > 0
    for _ in range(8):
        other = vectors * rng.choice([-1, 1], 4) + rng.uniform(-1e-12, 1e-12, vectors.shape)
        np.testing.assert_allclose(same_signs(other), expected, atol=1e-11)


def test_components_are_turned_one_way() -> None:
    rows = np.random.default_rng(1).standard_normal((6, 40))
    mixing = leading(rows, 0.0, 6).mixing
    np.testing.assert_array_equal(same_signs(mixing), mixing)
    np.testing.assert_allclose(mixing.T @ rows @ rows.T @ mixing, np.eye(6), atol=1e-12)
