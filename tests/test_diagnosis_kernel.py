"""The compiled loop against the laws that it is made of, one step of JAX at a time."""

import os
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_diagnosis_plant import NOMINAL, STEP

from gatjax.diagnosis import kernel, lanes, laws, loop, plant
from gatjax.diagnosis.lanes import Named

STEPS, LEAD, RUNS, TERMS = 400, 100, 2, 5


def grid(rng):
    """Series of two runs, in which nothing is simple."""
    time = (np.arange(STEPS) - LEAD) * STEP
    wave = np.sin(9.0 * time[:, None] + np.arange(RUNS))
    rough = 0.3 * np.cumsum(rng.normal(size=(STEPS, RUNS)), 0) / np.sqrt(STEPS)
    terms = 0.2 * rng.normal(size=(3, STEPS, RUNS, TERMS))
    terms[2] *= 1e-3
    series = {
        "target": 0.4 * wave + rough, "path": 0.4 * wave, "reading": 0.38 * wave,
        "rest": 1.0 + wave, "slope": 2.0 * wave, "pull": wave,
        "inertia": 0.02 + 0.01 * wave, "rest_terms": terms[0],
        "slope_terms": terms[1], "inertia_terms": terms[2],
        "stiffness": np.where(time[:, None] > 0.25, 0.5, 1.0) + 0.0 * wave,
        "supply": np.abs(wave), "clock": time[:, None] + 0.0 * wave,
        "running": 1.0 * (time[:, None] < 0.2) + 0.0 * wave,
    }  # fmt: skip
    return laws.Grid(**{k: v.astype(np.float32) for k, v in series.items()})


def drives(rng, count):
    """Joints in which every law acts, each by another amount."""
    most = {
        "delay": 0.02, "late": 0.01, "drift": 0.02, "lag": 0.02, "quantum": 0.02,
        "dead": 0.01, "stiction": 0.3, "loaded": 0.1, "of_link": 1.0,
        "asymmetric": 0.2, "lean": 0.2, "one_sided": 0.1, "ripple": 0.3,
        "ripple_phase": 3.0, "zero_in": 0.02, "zero_out": 0.02, "heat": 0.5,
        "sag": 0.3, "soft": 0.1,
        "width": 0.02, "ratio": 0.5, "sensed": 1.0, "link_share": 0.8,
        "behind": 0.8, "linked": 1.0, "drag": 0.1, "spring": 0.5, "bias": 0.2,
        "wave": 0.3, "wave_phase": 1.0, "integral": 2.0, "skew": 0.3, "pull": 20.0,
        "steer": 100.0,
    }  # fmt: skip
    zero = dict.fromkeys(loop.NUMBERS, 0.0)
    given = zero | NOMINAL | {"friction": 0.1, "cycles": 40.0, "frequency": 12.0}
    given |= {"speed": 8.0, "rate": 6.0, "limit": 4.0, "scale": 1.02}
    columns = {k: np.full(count, v) for k, v in given.items()}
    columns |= {k: v * rng.uniform(size=count) for k, v in most.items()}
    for name in ("quantum", "width", "behind"):  # some lanes go one way, some another
        columns[name][::2] = 0.0
    numbers = [np.asarray(columns[name], np.float32) for name in loop.NUMBERS]
    terms = rng.normal(size=(count, TERMS)).astype(np.float32)
    return laws.Drive(*numbers, terms=terms)


def read(p, seen, time):
    """Readings at the stamps [R, N] -> [R, N, S] of angles [K, R, S]."""
    p = laws.Drive(*(number[None, None] for number in p[:-1]), terms=p.terms)
    last = seen.shape[0] - 2.0
    at = jnp.clip(plant.place(p, time[..., None], LEAD, STEP), 0.0, last)
    whole = jnp.floor(at)
    part = (at - whole).astype(seen.dtype)
    index = whole.astype(jnp.int32)
    run = jnp.arange(time.shape[0])[:, None, None]
    sim = jnp.arange(seen.shape[-1])[None, None]
    q = seen[index, run, sim] * (1.0 - part) + seen[index + 1, run, sim] * part
    return plant.encoded(p, q)


def stepped(p, g, time, geared, drawn):
    """The same by single steps: readings, angle of the link and heat."""
    one = laws.Drive(*(number[None] for number in p[:-1]), terms=p.terms)
    weighed = laws.weighed(p, g)
    run = np.arange(RUNS)[:, None]

    def aimed(k):
        later = plant.later(one, g.clock[k][:, None], STEP)
        place = np.clip(np.asarray(k + later), 0.0, STEPS - 2.0)
        whole = np.floor(place).astype(int)
        part, old = place - whole, g.reading[whole, run]
        return plant.decoded(one, old + part * (g.reading[whole + 1, run] - old))

    def told(k):
        late = p.delay / STEP + 0.5
        whole = np.floor(late).astype(int)
        part = late - whole
        newer, older = (np.maximum(k - whole - n, 0) for n in (0, 1))
        return g.target[newer].T * (1.0 - part) + g.target[older].T * part

    step = jax.jit(partial(plant.advanced, h=STEP))
    kind = plant.Geared if geared else plant.Rigid
    first = np.broadcast_to(g.target[0][:, None], (RUNS, len(p.kp)))
    state = plant.begun(kind, one, first, aimed(0))
    seen, link = [], []
    for k in range(STEPS):
        aim = aimed(k) if drawn else state.seen(one)
        at = jax.tree.map(lambda series, k=k: series[k], weighed)
        state = step(one, at, told(k), aim, state)
        seen.append(state.seen(one))
        link.append(state.q)
    seen, link = np.stack(seen), np.stack(link)
    readings = read(p, jnp.asarray(seen), jnp.asarray(time))
    return readings, link, state.servo.heat


@pytest.mark.parametrize("drawn", [False, True])
@pytest.mark.parametrize(("geared", "count"), [(False, 3), (False, 70), (True, 18)])
def test_the_loop_does_what_single_steps_do(geared, count, drawn):
    """Of 3 a register is part full, of 70 there are two blocks."""
    rng = np.random.default_rng(count)
    g, p = grid(rng), drives(rng, count)
    time = np.tile(np.arange(0.0, 0.28, 0.01, np.float32), (RUNS, 1))
    with jax.enable_x64(False):
        readings, link, heat = stepped(p, g, time, geared, drawn)
    found = kernel.simulate(p, g, time, LEAD, STEP, geared, drawn, moving=True)
    assert np.std(readings, axis=2).min() > 1e-3
    assert found.readings == pytest.approx(np.asarray(readings), abs=3e-5)
    assert found.angle == pytest.approx(link, abs=3e-5)
    assert found.heat == pytest.approx(np.asarray(heat), rel=1e-3)
    still = kernel.simulate(p, g, time, LEAD, STEP, geared, drawn)
    assert np.array_equal(still.readings, found.readings) and still.angle.size == 0


def test_a_simulation_does_not_depend_on_those_beside_it():
    rng = np.random.default_rng(0)
    g, p = grid(rng), drives(rng, 70)
    time = np.tile(np.arange(0.0, 0.28, 0.01, np.float32), (RUNS, 1))
    one = laws.Drive(*(field[66:67] for field in p))
    alone, among = (
        kernel.simulate(each, g, time, LEAD, STEP, False, False).readings
        for each in (one, p)
    )
    assert np.array_equal(alone[..., 0], among[..., 66])


HELPERS = loop.TEMPLATE.split("@njit(nogil")[0]


def run(code, **given):
    """What code leaves in its outputs, run by Python."""
    names = {}
    exec(HELPERS, names)
    plain = {k: names[k].py_func for k in ("sign", "floor", "exp")}
    names |= plain | given
    for line in code.lines:
        exec(line.code, names)
    return [float(eval(out, names)) for out in code.outputs]


CASES = {
    "clip": lambda x, y: jnp.clip(x * y, -0.5, 0.5),
    "where": lambda x, y: jnp.where((x > y) & ~(x == 0.0) | (y >= 2.0), x - y, -y),
    "rounds": lambda x, y: (jnp.round(3.3 * x), jnp.floor(2.0 * y), jnp.sign(x)),
    "powers": lambda x, y: (jnp.exp(-jnp.square(x / 0.1)), jnp.sqrt(jnp.abs(y))),
    "truth": lambda x, y: jnp.where(x, 1.0, 2.0) * (y != 1.0) * (x < y) * (x <= y),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("x", [-1.5, 0.0, 0.04, 2.0])
@pytest.mark.parametrize("y", [-0.7, 1.0, 2.0])
def test_written_code_says_what_its_function_does(name, x, y):
    function = CASES[name]
    code = lanes.written(function, (Named("x"), Named("y")), "t")
    with jax.enable_x64(False):
        right = jax.tree.leaves(function(*np.float32([[[x]], [[y]]])))
    found = run(code, x=np.float32(x), y=np.float32(y))
    assert found == pytest.approx([float(n[0, 0]) for n in right], rel=1e-5, abs=1e-7)


def test_what_is_fixed_is_done_once_and_not_divided_by_again():
    def function(x, y):
        slow = jnp.where(y > 0.0, y, 1.0) + 1.0
        return x / slow + jnp.where(y > 0.0, x, -x)

    code = lanes.written(function, (Named("x"), Named("y")), "t")
    once, left = lanes.hoisted(code, ["y"])
    for y in (-2.0, 3.0):
        given = {"x": np.float32(5.0), "y": np.float32(y)}
        kept = {}
        for line in once:
            kept[line.name] = run(lanes.Code([line], [line.name]), **given, **kept)[0]
        numbers = {line.name: kept[line.name] for line in once if not line.truth}
        assert run(left, **given, **numbers) == pytest.approx(run(code, **given))
    assert not any("/" in line.text for line in left.lines)
    uses = {name for line in left.lines for name in line.uses}
    assert not uses & {line.name for line in once if line.truth} - {
        line.name for line in left.lines
    }


def test_what_cannot_be_written_is_refused():
    with pytest.raises(KeyError, match="sin"):
        lanes.written(jnp.sin, (Named("x"),), "t")


def test_exponentials_are_near_enough():
    names = {}
    exec(HELPERS, names)
    x = np.linspace(-30.0, 10.0, 401).astype(np.float32)
    found = np.array([names["exp"](each) for each in x])
    assert found == pytest.approx(np.exp(x.astype(float)), rel=1e-5)


@pytest.mark.parametrize("name", ["late", "delay", "kp"])
@pytest.mark.parametrize("drawn", [False, True])
def test_a_number_that_is_none_spoils_its_own_simulation_only(name, drawn):
    rng = np.random.default_rng(1)
    g, p = grid(rng), drives(rng, 20)
    time = np.tile(np.arange(0.0, 0.28, 0.01, np.float32), (RUNS, 1))
    bad = getattr(p, name).copy()
    bad[[3, 4, 5]] = np.nan, 1e30, -1e30
    right, found = (
        kernel.simulate(each, g, time, LEAD, STEP, False, drawn).readings
        for each in (p, p._replace(**{name: bad}))
    )
    assert np.isnan(found[..., 3]).all()
    assert np.array_equal(
        np.delete(right, [3, 4, 5], 2), np.delete(found, [3, 4, 5], 2)
    )


SMALL = """
from numba import njit

@njit(cache=<cached>)
def more(x):
    return x + 1

@njit(cache=<cached>)
def simulate(x):
    return more(x)
"""


def test_the_loop_is_compiled_once_where_jax_keeps_its_programs(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel.jax, "config", SimpleNamespace(
        jax_compilation_cache_dir=str(tmp_path)
    ))  # fmt: skip
    monkeypatch.setattr(kernel, "source", lambda *asked: SMALL)
    for hits in (0, 1):
        made = kernel._module.__wrapped__(False, False, STEP)
        assert made.simulate(1) == 2
        assert sum(made.simulate.stats.cache_hits.values()) == hits
        del sys.modules[made.__name__]
    (file,) = (tmp_path / "numba").glob("joint_*.py")
    assert Path(made.__file__) == file


@pytest.mark.parametrize("folder", [None, "/proc/nowhere"])
def test_without_such_a_folder_it_is_made_anew(monkeypatch, folder):
    monkeypatch.setattr(kernel.jax, "config", SimpleNamespace(
        jax_compilation_cache_dir=folder
    ))  # fmt: skip
    monkeypatch.setattr(kernel, "source", lambda *asked: SMALL)
    assert kernel._module.__wrapped__(False, False, STEP).simulate(1) == 2
    assert folder is None or not os.path.exists(folder)
