"""Packages that do not go together are told, before anything is compiled."""

import sys
from importlib import metadata

import jax
import mujoco
import pytest

from gatjax.cli import doctor, main
from gatjax.loop import setting
from gatjax.settings import LoopSettings
from gatjax.sim import mjxmodel, versions

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
    for module in (mjxmodel, doctor):
        monkeypatch.setattr(module, "mismatch", lambda: words)
    with pytest.raises(ValueError, match=r"0\.9\.0 is installed"):
        mjxmodel.check_machine("jax")
    found = _first(doctor.examine(), 12)
    assert ("versions", words) in found
    assert dict(found)["backend"].startswith("refused, see versions")


def test_auto_does_not_take_native_where_a_gpu_may_have_been_left_out(monkeypatch):
    words = "jax 0.10.2 needs jax-cuda12-plugin ==0.10.2, 0.9.0 is installed"
    monkeypatch.setattr(setting, "mismatch", lambda: words)
    with pytest.raises(ValueError, match=r"0\.9\.0 is .*--backend native"):
        setting.resolved(LoopSettings())
    assert setting.resolved(LoopSettings(backend="native")).backend == "native"


@pytest.fixture
def gpu(tmp_path):
    (tmp_path / "nvidia0").touch()
    (tmp_path / "nvidiactl").touch()
    return tmp_path


def test_a_gpu_that_jax_leaves_out_is_told_where_its_plugin_is_installed(
    gpu, tmp_path_factory, monkeypatch
):
    def only(plugin):
        return lambda name: GOOD[name.replace("13", "12")] if name == plugin else gone()

    def gone():
        raise metadata.PackageNotFoundError

    monkeypatch.delenv("JAX_PLATFORMS", raising=False)
    for plugin in ("jax-cuda12-plugin", "jax-cuda13-plugin"):
        line = versions.unused_gpu(only(plugin), gpu)
        assert line.startswith("JAX does not use this machine's NVIDIA GPU though")
        assert f"{plugin} 0.10.2" in line and "\n" not in line
    assert versions.unused_gpu(only("none"), gpu) is None  # JAX itself warns
    nothing = tmp_path_factory.mktemp("dev")
    assert versions.unused_gpu(only("jax-cuda12-plugin"), nothing) is None
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert versions.unused_gpu(only("jax-cuda12-plugin"), gpu) is None
    monkeypatch.setattr(jax, "default_backend", lambda: "cpu")
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")  # asked for
    assert versions.unused_gpu(only("jax-cuda12-plugin"), gpu) is None


def test_auto_and_doctor_tell_of_it(monkeypatch):
    words = "JAX does not use this machine's NVIDIA GPU"
    for module in (setting, doctor):
        monkeypatch.setattr(module, "unused_gpu", lambda: words)
    with pytest.raises(ValueError, match=r"NVIDIA GPU .*--backend native"):
        setting.resolved(LoopSettings())
    assert setting.resolved(LoopSettings(backend="native")).backend == "native"
    found = dict(_first(doctor.examine(), 12))
    assert found["devices"] == f"broken: {words}"
    assert found["backend"].startswith("refused, see devices")


def test_a_plugin_that_cannot_start_is_a_finding(monkeypatch):
    def broken():
        raise RuntimeError("Unable to initialize backend 'cuda':\n INTERNAL: 35")

    monkeypatch.setattr(jax, "devices", broken)
    *_, last = doctor.examine()
    assert last == (
        "devices",
        "broken: Unable to initialize backend 'cuda': INTERNAL: 35",
    )


class Aged:
    """Import hook: MJX looks for what this MuJoCo does not have."""

    def find_spec(self, name, path, target=None):
        if name == "mujoco.mjx":
            raise AttributeError("mujoco has no mjtSleepPolicy")


def test_an_mjx_that_cannot_be_imported_is_one_line(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(sys, "meta_path", [Aged(), *sys.meta_path])
    for name in ("mujoco.mjx", "gatjax.sim.mjx", "gatjax.sim.mjxmodel"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.delattr(mujoco, "mjx")
    assert main(["search", "--backend", "mjx", "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "mjtSleepPolicy); install" in said
    assert "internal error" not in said
    found = dict(_first(doctor.examine(), 12))
    assert found["MJX-Warp"].startswith("broken: mujoco-mjx does not go with mujoco")
    assert "backend" in found


@pytest.mark.parametrize(
    ("lacks", "said"), [("no GPU", "no GPU"), (None, "can run (what --impl auto means")]
)
def test_doctor_says_what_warp_lacks(monkeypatch, lacks, said):
    monkeypatch.setattr(mjxmodel, "lacking_for_warp", lambda: lacks)
    found = dict(_first(doctor.examine(), 12))
    assert found["MJX-Warp"].startswith(said)


def _first(findings, count):
    return [finding for finding, _ in zip(findings, range(count), strict=False)]
