"""Packages that do not go together are told, before anything is compiled."""

from importlib import metadata

import pytest

from gatjax.cli import doctor
from gatjax.sim import mjx, versions

REQUIRES = {
    "mujoco-mjx": ["mujoco>=3.17.0.dev0", "scipy", "warp-lang==1.1; extra == 'warp'"],
    "jax": [
        "jaxlib<=0.10.2,>=0.10.2",
        'jax-cuda12-plugin<=0.10.2,>=0.10.2; extra == "cuda12"',
    ],
    "jax-cuda12-plugin": ["jax-cuda12-pjrt==0.10.2"],
}
GOOD = {
    "mujoco-mjx": "3.17.0", "mujoco": "4.0.0", "jax": "0.10.2", "jaxlib": "0.10.2",
    "jax-cuda12-plugin": "0.10.2", "jax-cuda12-pjrt": "0.10.2",
}  # fmt: skip


def told(installed):
    def version(package):
        if package not in installed:
            raise metadata.PackageNotFoundError(package)
        return installed[package]

    def requires(package):
        version(package)
        return REQUIRES.get(package)

    return versions.mismatch(requires, version)


def test_this_installation_goes_together():
    assert versions.mismatch() is None
    assert told(GOOD) is None


def test_what_is_not_installed_is_not_needed():
    assert told({k: v for k, v in GOOD.items() if "cuda" not in k}) is None


@pytest.mark.parametrize(
    ("package", "old", "says"),
    [
        ("mujoco", "3.2.0", "mujoco-mjx 3.17.0 needs mujoco >=3.17.0.dev0, 3.2.0 is"),
        ("jaxlib", "0.9.0", "jax 0.10.2 needs jaxlib <=0.10.2,>=0.10.2, 0.9.0 is"),
        ("jax-cuda12-plugin", "0.9.0", "jax 0.10.2 needs jax-cuda12-plugin"),
        ("jax-cuda12-pjrt", "0.9.0", "jax-cuda12-plugin 0.10.2 needs jax-cuda12-pjrt"),
    ],
)
def test_a_package_of_another_age_is_named(package, old, says):
    line = told(GOOD | {package: old})
    assert line.startswith(says)
    assert "\n" not in line


def test_mjx_refuses_them_and_doctor_says_so(monkeypatch):
    words = "jax 0.10.2 needs jaxlib >=0.10.2, 0.9.0 is installed"
    for module in (mjx, doctor):
        monkeypatch.setattr(module, "mismatch", lambda: words)
    with pytest.raises(ValueError, match=r"0\.9\.0 is installed"):
        mjx.check_machine("jax")
    assert ("versions", words) in _first(doctor.examine(), 9)


@pytest.mark.parametrize(
    ("lacks", "said"), [("no GPU", "no GPU"), (None, "can run (what --impl auto means")]
)
def test_doctor_says_what_warp_lacks(monkeypatch, lacks, said):
    monkeypatch.setattr(mjx, "lacking_for_warp", lambda: lacks)
    found = dict(_first(doctor.examine(), 12))
    assert found["MJX-Warp"].startswith(said)


def _first(findings, count):
    return [finding for finding, _ in zip(findings, range(count), strict=False)]
