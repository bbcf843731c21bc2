"""Largest error by edge normals: against a programme with a column for every draw, and shapes known by hand."""

from dataclasses import replace

import numpy as np
import pytest

from nebosvod.errors import GeometryError
from nebosvod.estimation import Block, LinearProblem, Prior, White
from nebosvod.estimation.accuracy import guaranteed
from nebosvod.estimation.accuracy.zonogon import Segments, largest


def test_normals_are_the_edges_at_the_price_of_their_support():
    """Half sides 3 and 1: the rectangle |x| <= 3, |y| <= 1 has normals y/1 and x/3."""
    segments = Segments.of([(np.array([0]), np.array([[[3.0, 0.0], [0.0, 1.0], [0.0, 0.0]]]))], n=1, p=2)
    np.testing.assert_allclose(np.abs(segments.normals()[0]), [[0.0, 1.0], [1.0 / 3.0, 0.0], [0.0, 0.0]])


def test_one_plane_measurement_reaches_the_corners_of_its_zonogon():
    """Brute force: the farthest corner over all signs of the segments."""
    rng = np.random.default_rng(3)
    ends = rng.normal(size=(1, 5, 2))
    segments = Segments.of([(np.array([0]), ends)], n=1, p=2)
    directions = rng.normal(size=(20, 2))
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 5)).reshape(5, -1).T
    corners = signs @ ends[0]
    found = largest(np.eye(2)[None], segments, boxed=0, level=1.0, objective=directions)
    np.testing.assert_allclose(found, (corners @ directions.T).max(axis=0), rtol=1e-9)


@pytest.mark.parametrize("p", [1, 2])
@pytest.mark.parametrize("z", ["none", "white"])
def test_a_column_for_every_draw_gives_the_same(make_problem, p, z):
    problem = make_problem(seed=5, n=12, p=p, z=z, treatments={"c": "considered"}, state_prior="none")
    names = ("x", "y", "c1")
    found = guaranteed.largest_error(problem, np.eye(3), names)
    silent = replace(problem, residual=np.zeros_like(problem.residual))
    np.testing.assert_allclose(found, guaranteed._by_draws(silent, np.eye(3), names, 3.0), rtol=1e-6)


def test_two_nuisances_on_one_measurement_add_up():
    """Noise 1, two white errors of 2 and 3 and a prior of 4 on one of two unknowns: 3 (1 + 2 + 3 + 4)."""
    n = 3
    blocks = (
        Block(name="x", names=("x",), H=np.ones((n, 1, 1))),
        Block(name="b", names=("b",), H=np.ones((n, 1, 1))),
    )
    white = tuple(White(name=f"z{s}", H=np.ones((n, 1, 1)), Q=[[s * s]], rows=np.arange(n)) for s in (2.0, 3.0))
    prior = Prior(name="b", names=("b",), covariance=[[16.0]])
    problem = LinearProblem(residual=np.zeros((n, 1)), R=[[1.0]], blocks=blocks, priors=(prior,), white=white)
    assert guaranteed.largest_error(problem, [[1.0, 0.0]], ("x", "b"))[0] == pytest.approx(30.0, rel=1e-9)
    assert guaranteed.largest_error(problem, [[0.0, 1.0]], ("x", "b"))[0] == pytest.approx(12.0, rel=1e-9)


def test_a_quantity_without_a_bound_is_said_to_have_none():
    block = Block(name="x", names=("x", "y"), H=np.ones((3, 2, 2)))
    problem = LinearProblem(residual=np.zeros((3, 2)), R=np.eye(2), blocks=(block,))
    with pytest.raises(GeometryError, match="not bounded"):
        guaranteed.largest_error(problem, [[1.0, 0.0]])
    assert guaranteed.largest_error(problem, [[1.0, 1.0]])[0] == pytest.approx(3.0, rel=1e-9)
