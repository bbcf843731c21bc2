"""Noise of an image: Fisher information on a grid of pixels, photons really drawn, and exposures of a mission."""

import numpy as np
import numpy.typing as npt
import pytest

from nebosvod.engine.assembly import nominal_view
from nebosvod.errors import InputError
from nebosvod.mission import Mission, load_mission, load_mission_text
from nebosvod.observation.measurement.image_noise import FWHM, image_covariance
from nebosvod.scene.scene import build_scene

Array = npt.NDArray[np.float64]
ARCSEC = np.pi / 648000.0
STAR = {"exposure_s": 1.0, "fwhm_rad": 2.0 * ARCSEC, "magnitude": 20.0, "snr": 10.0}


def fisher(trail: float, s: float) -> tuple[Array, float]:
    """Covariance of a fitted place and int h^2, of an image of unit flux in unit white noise on a fine grid; arcsec."""
    x = np.linspace(-20.0, 20.0, 801)
    step = x[1] - x[0]
    spread = trail * ((np.arange(401) + 0.5) / 401 - 0.5)
    line = np.exp(-((x[:, None] - spread) ** 2) / (2 * s**2)).mean(axis=1) / np.sqrt(2 * np.pi) / s
    side = np.exp(-(x**2) / (2 * s**2)) / np.sqrt(2 * np.pi) / s
    image = line[:, None] * side
    slopes = np.gradient(image, step, edge_order=2)
    information = np.array([[np.sum(a * b) for a in slopes] for b in slopes]) * step**2
    return np.linalg.solve(information, np.eye(2)), float(np.sum(image**2) * step**2)


@pytest.mark.parametrize("trail", [0.0, 0.5, 3.0, 12.0])
def test_against_a_background_it_is_the_bound_of_cramer_and_rao(trail: float) -> None:
    s = 2.0 / FWHM
    star, power = fisher(0.0, s)
    scale = 10.0**2 / power  # noise for which a star of magnitude 20 has a ratio of 10
    bound, _ = fisher(trail, s)
    rate = trail * ARCSEC * np.array([[np.cos(0.3), np.sin(0.3)]])
    R = image_covariance(np.array([20.0]), rate, np.zeros(1), **STAR)[0] / ARCSEC**2
    c, n = np.cos(0.3), np.sin(0.3)
    turned = np.array([[c, n], [-n, c]])
    assert turned @ R @ turned.T == pytest.approx(bound / scale, rel=2e-3, abs=1e-9)
    if trail == 0.0:
        assert pytest.approx(star / scale, rel=2e-3, abs=1e-9) == R
        assert R[0, 0] == pytest.approx(2.0 * s**2 / 100.0, rel=1e-9)


def test_a_magnitude_fainter_is_2_5_times_worse_against_a_background_and_1_6_times_of_photons() -> None:
    V, still, point = np.array([20.0, 21.0]), np.zeros((2, 2)), np.zeros(2)
    sky = image_covariance(V, still, point, **STAR, limited_by="background")
    own = image_covariance(V, still, point, **STAR, limited_by="photons")
    assert sky[1] == pytest.approx(10.0**0.8 * sky[0])
    assert own[1] == pytest.approx(10.0**0.4 * own[0])


def test_of_photons_it_is_the_error_of_their_mean() -> None:
    """400 images of 100 photons of a star, a disc and a trail."""
    rng, theta, trail = np.random.default_rng(4), 3.0, 6.0
    s, shape = 2.0 / FWHM, (400, 100)
    angle, radius = 2 * np.pi * rng.random(shape), theta * np.sqrt(rng.random(shape))
    x = s * rng.standard_normal(shape) + radius * np.cos(angle) + trail * (rng.random(shape) - 0.5)
    y = s * rng.standard_normal(shape) + radius * np.sin(angle)
    rate = np.array([[trail * ARCSEC, 0.0]])
    R = image_covariance(np.array([20.0]), rate, np.array([theta * ARCSEC]), **STAR, limited_by="photons")[0]
    drawn = [np.var(one.mean(axis=1)) for one in (x, y)]
    assert np.diag(R) / ARCSEC**2 == pytest.approx(drawn, rel=0.25)  # 400 images: 3.5 sigma


def test_a_target_without_brightness_is_refused() -> None:
    with pytest.raises(InputError, match="finite magnitude"):
        image_covariance(np.array([np.inf]), np.zeros((1, 2)), np.zeros(1), **STAR)


@pytest.fixture(scope="module")
def bright() -> Mission:
    text = load_mission("minimal").text
    text = text.replace("  radius: {", "  magnitude: {H: 26.5}\n  radius: {")
    noise = (
        "noise: {sigma: 0.1 arcsec, image: {magnitude: 22, snr: 20}}\n    trailing: {exposure: 60 s, fwhm: 2 arcsec}"
    )
    return load_mission_text(text.replace("noise: {sigma: 0.1 arcsec}", noise))


def test_the_noise_of_a_mission_follows_its_brightness_and_motion(bright: Mission) -> None:
    scene = build_scene(bright)
    seen = nominal_view(scene).observation
    for row in (0, seen.t_s.size // 2, seen.t_s.size - 1):
        telescope = scene.telescopes[seen.telescope_index[row]]
        number = scene.telescopes.index(telescope)
        visible = scene.visibilities[number]
        V = visible.apparent_magnitude[np.argmin(np.abs(visible.t_s - seen.t_s[row]))]
        L = np.linalg.norm(seen.rate[row]) * 60.0 / ARCSEC
        bound, _ = fisher(L, 2.0 / FWHM)
        power = 20.0**2 * 10.0 ** (-0.8 * (V - 22.0)) / fisher(0.0, 2.0 / FWHM)[1]
        along = seen.rate[row] / np.linalg.norm(seen.rate[row])
        turned = np.array([along, [-along[1], along[0]]])
        R = turned @ (seen.noise[row] / ARCSEC**2) @ turned.T
        assert pytest.approx(bound / power + 0.01 * np.eye(2), rel=2e-3, abs=1e-6) == R
    assert seen.noise[:, 0, 0].max() > 1.3 * seen.noise[:, 0, 0].min()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("  magnitude: {H: 26.5}\n", "", "magnitude"),
        ("trailing: {exposure: 60 s, fwhm: 2 arcsec}", "limiting_magnitude: 30", "trailing"),
    ],
)
def test_what_the_noise_of_an_image_needs_is_asked_for(old: str, new: str, said: str, bright: Mission) -> None:
    assert old in bright.text
    with pytest.raises(InputError, match=said):
        load_mission_text(bright.text.replace(old, new))
