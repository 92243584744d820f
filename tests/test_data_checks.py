"""What a log lacks is found and said; a good log gets nothing but facts."""

import numpy as np
import pytest
from scipy.signal import lfilter

from gatjax.data.checks import findings, same_commands, same_data, summary, trusted
from gatjax.data.finding import Finding
from gatjax.data.recording import Recording
from gatjax.data.sampling import after_gaps

JOINTS = ("hip", "knee")
RANGES = {"hip": (-1.2, 1.0), "knee": (-0.3, 2.2)}
STEP = 2 * np.pi / 4096  # rad, 12 bit encoder
PERIOD = 0.01  # s
KINDS = ("command", "position")


def log(seed=0, name="fit.parquet", seconds=12.0, delay=0.03, **columns):
    """A healthy log: the joints follow smooth commands, with rests at both ends."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, PERIOD)
    fade = np.clip(np.minimum(time - 0.6, seconds - 0.6 - time), 0.0, 1.0)
    tones = random.uniform(0.3, 2.2, (len(JOINTS), 3))
    made = {}
    for joint, centre, rates in zip(JOINTS, (-0.1, 0.8), tones, strict=True):

        def target(when, rates=rates, centre=centre):
            waves = np.sin(2 * np.pi * rates * np.maximum(when, 0.0)[:, None]).sum(-1)
            return centre + 0.17 * np.interp(when, time, fade) * waves

        noise = random.normal(0.0, 0.0005, len(time))
        made[f"command.{joint}"] = target(time)
        seen = target(time - delay) + noise
        made[f"position.{joint}"] = STEP * np.round(seen / STEP)
    stamps = time + random.uniform(-0.0005, 0.0005, len(time))
    made.update(columns)
    return Recording(name, stamps, np.zeros(len(time), int), made, {"rate_hz": 100.0})


def found(recording, check, role="fit", ranges=RANGES):
    return [each for each in findings(recording, ranges, role) if each.check == check]


def only(recording, check, level, role="fit", ranges=RANGES):
    """The one finding of a check, which must have this level."""
    (finding,) = found(recording, check, role, ranges)
    assert finding.level == level
    assert finding.text.startswith(recording.name) and "\n" not in finding.text
    return finding


def changed(recording, **columns):
    return recording._replace(columns={**recording.columns, **columns})


@pytest.mark.parametrize("seed", range(4))
def test_good_log_gets_facts_only(seed):
    every = findings(log(seed), RANGES, "fit")
    assert [each.text for each in every if each.level != "info"] == []
    assert {"rate", "encoder step", "noise", "reversals", "range", "rest", "delay"} == {
        each.check for each in every
    }


def test_noise_is_told_from_motion():
    """In trajectories that take turns, and at few rows a second."""
    one, other = log(), log(seed=1)
    order = np.argsort(np.tile(one.time, 2), kind="stable")
    turns = Recording(
        "turns", np.concatenate([one.time, other.time])[order],
        np.repeat([0, 1], len(one.time))[order],
        {c: np.concatenate([v, other.columns[c]])[order]
         for c, v in one.columns.items()},
        one.metadata,
    )  # fmt: skip
    draw, time = np.random.default_rng(0), np.arange(0.0, 40.0, 0.05)
    sweep = 0.5 * np.sin(2.0 * np.pi * (0.2 + 0.015 * time) * time)
    seen = sweep + 7e-4 * draw.normal(size=len(time))
    columns = {"command.hip": sweep, "position.hip": seen}
    slow = Recording("slow", time, np.zeros(len(time), int), columns, {"rate_hz": 20.0})
    for each, most in ((turns, 1.5e-3), (slow, 1.2e-3)):
        assert 2e-4 < only(each, "noise", "info").values["hip"] < most


def test_numbers_of_a_good_log_are_right():
    good = log()
    rate = only(good, "rate", "info").values
    assert rate["period"] == pytest.approx(PERIOD, rel=0.02)
    assert only(good, "encoder step", "info").values["hip"] == pytest.approx(STEP)
    noise = np.hypot(0.0005, STEP / np.sqrt(12))
    assert only(good, "noise", "info").values["knee"] == pytest.approx(noise, rel=0.4)
    assert only(good, "delay", "info").values["hip"] == pytest.approx(0.03, abs=0.001)
    share = np.ptp(good.columns["position.knee"]) / 2.5
    assert only(good, "range", "info").values["knee"] == pytest.approx(share)
    assert only(good, "rest", "info").values["rests"] == 2.0
    paused = {name: values.copy() for name, values in good.columns.items()}
    for joint in JOINTS:
        paused[f"command.{joint}"][500:520] = paused[f"command.{joint}"][500]
    assert only(changed(good, **paused), "rest", "info").values["rests"] == 2.0


def test_reversals_are_turns_of_the_position_and_noise_makes_none():
    good = log()
    turns = np.abs(np.diff(np.sign(np.diff(good.columns["command.hip"]))))
    value = only(good, "reversals", "info").values["hip"]
    assert 0.6 * np.sum(turns == 2) <= value <= np.sum(turns == 2)


@pytest.mark.parametrize(
    ("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns"), (1e-4, None)]
)
def test_time_in_another_unit_is_refused_with_the_map_that_mends_it(factor, unit):
    wrong = log()
    finding = only(wrong._replace(time=factor * wrong.time), "rate", "refuse")
    assert "column 'time'" in finding.text
    assert (f"{{unit: {unit}}}" if unit else "in seconds") in finding.text


def test_a_trajectory_of_half_an_hour_is_refused():
    long = log(seconds=1000.0)
    assert "trajectory 0 lasts 1000 s" in only(long, "rate", "refuse").text


def test_rate_that_contradicts_the_metadata_is_warned_of():
    assert (
        "50 Hz"
        in only(log()._replace(metadata={"rate_hz": 50.0}), "rate", "warning")[2]
    )


def without(whole, *parts):
    """A log that lacks some rows."""
    keep = np.setdiff1d(np.arange(len(whole.time)), np.concatenate(parts))
    columns = {name: values[keep] for name, values in whole.columns.items()}
    return Recording("gap.csv", whole.time[keep], whole.trajectory[keep], columns, {})


def test_gap_names_its_row_and_what_it_costs():
    finding = only(without(log(), np.r_[400:430]), "gaps", "warning")
    assert "row 401" in finding.text and "(4% of the rows)" in finding.text
    assert finding.values["longest"] == pytest.approx(0.31, abs=0.002)
    assert finding.values["lost"] == pytest.approx(50 / 1170, abs=0.002)


def test_a_short_gap_costs_nothing():
    finding = only(without(log(), np.r_[400:403]), "gaps", "warning")
    assert finding.values["lost"] == 0.0 and "do not count" not in finding.text


@pytest.mark.parametrize(
    "parts", [[np.r_[400:510]], [np.r_[k : k + 20] for k in range(100, 1100, 60)]]
)
def test_a_second_without_rows_or_a_log_full_of_gaps_is_refused(parts):
    finding = only(without(log(), *parts), "gaps", "refuse")
    assert "log without gaps" in finding.text


def test_a_gap_at_rest_is_none():
    time = np.r_[0.0:1.0:0.01, 2.0:3.0:0.01]
    command = np.where(time > 2.5, 0.3, 0.0)[:, None]
    assert not after_gaps(time, command).any()
    moved = after_gaps(time, np.where(time > 1.5, 0.3, 0.0)[:, None])
    assert moved[100:149].all() and not moved[:100].any() and not moved[152:].any()


def test_coarse_encoder_is_warned_of():
    good = log()
    coarse = 0.02 * np.round(good.columns["position.hip"] / 0.02)
    finding = only(changed(good, **{"position.hip": coarse}), "encoder step", "warning")
    assert finding.values["hip"] == pytest.approx(0.02) and "position.hip" in finding[2]


def test_degrees_below_a_full_turn_are_refused():
    random = log()
    small = {
        name: np.rad2deg(0.3 * (values - values.mean()))
        for name, values in random.columns.items()
    }
    refused = found(changed(random, **small), "units")
    assert {each.level for each in refused} == {"refuse"}
    assert any("row " in each.text and "unit: deg" in each.text for each in refused)


def degrees(recording, *columns):
    turned = {name: np.rad2deg(recording.columns[name]) for name in columns}
    return changed(recording, **turned)


def test_only_columns_in_degrees_are_to_be_mapped():
    """Of three joints one is in degrees: its own column; or all: the family."""
    good = log()
    shoulder = {f"{kind}.arm": good.columns[f"{kind}.hip"] for kind in KINDS}
    ranges = {**RANGES, "arm": (-1.2, 1.0)}
    three = changed(good, **shoulder)
    for family in KINDS:
        one = found(degrees(three, f"{family}.hip"), "units", ranges=ranges)
        every = [f"{family}.{joint}" for joint in (*JOINTS, "arm")]
        whole = found(degrees(three, *every), "units", ranges=ranges)
        assert {f"{{{family}.hip: {{unit: deg}}}}" in each.text for each in one} == {
            True
        }
        assert {f"{{{family}.*: {{unit: deg}}}}" in e.text for e in whole} == {True}
        assert len({each.text for each in whole}) >= 3


def test_a_position_beyond_its_limits_is_not_degrees_unless_it_moves_that_far():
    good = log()
    hip = good.columns["position.hip"]
    moved = changed(good, **{"position.hip": hip + 2.0})
    assert found(moved, "units") == []
    assert "sign or offset" in only(moved, "offset", "refuse").text


@pytest.mark.parametrize("fault", ["sign", "swapped"])
def test_what_explains_other_refusals_is_told_first(fault):
    """The knee's range begins near 0: its turned or swapped position leaves it."""
    good = log()
    hip, knee = (good.columns[f"position.{joint}"] for joint in JOINTS)
    wrong = {"position.knee": -knee}
    if fault == "swapped":
        wrong = {"position.knee": hip - 1.0, "position.hip": knee}
    told = changed(good, **wrong)
    assert found(told, "offset") and found(told, fault)
    with pytest.raises(ValueError, match="sign: -1" if fault == "sign" else "swapped"):
        trusted([told], RANGES, "fit")


def test_mirrored_joints_that_are_swapped_have_no_turned_sign():
    good = log()
    mirrored = changed(good, **{
        f"{kind}.knee": 0.7 - good.columns[f"{kind}.hip"] for kind in KINDS
    })  # fmt: skip
    hip, knee = (mirrored.columns[f"position.{joint}"] for joint in JOINTS)
    swapped = changed(mirrored, **{"position.hip": knee, "position.knee": hip})
    assert found(swapped, "sign") == [] and len(found(swapped, "swapped")) == 2
    turned = changed(mirrored, **{"position.hip": knee})
    assert found(turned, "swapped") == [] and len(found(turned, "sign")) == 1


def test_a_joint_that_never_moves_is_warned_of_unless_it_moves_in_another_file():
    good = log()
    still = {f"{kind}.knee": np.full(len(good.time), 0.8) for kind in KINDS}
    held = changed(good, **still)

    def levels(*recordings):
        rows = trusted(list(recordings), RANGES, "fit")
        return [f.level for own in rows for f in own if f.check == "held still"]

    assert levels(held, held) == ["warning", "warning"]
    assert levels(held, good) == ["info"]


def test_a_held_out_log_of_a_fitted_motion_is_warned_of():
    good, other = log(), log(seed=5)
    again = changed(good, **{"position.hip": good.columns["position.hip"] + 0.001})
    (warned,), none = same_commands([other, good], [again, log(seed=6)])
    assert warned.level == "warning" and none == []


def test_position_in_another_unit_than_its_command_is_refused():
    good = log()
    wide = {joint: (-np.inf, np.inf) for joint in JOINTS}
    turned = changed(good, **{"position.hip": np.rad2deg(good.columns["position.hip"])})
    finding = only(turned, "units", "refuse", ranges=wide)
    assert "position.hip" in finding.text


def test_constant_position_is_refused_and_held_joint_is_told():
    good = log()
    dead = changed(good, **{"position.knee": np.full(len(good.time), 0.8)})
    finding = only(dead, "dead column", "refuse")
    assert "row 1, column 'position.knee'" in finding.text
    both = {
        f"{family}.knee": np.full(len(good.time), 0.8)
        for family in ("command", "position")
    }
    assert list(only(changed(good, **both), "held still", "info").values) == ["knee"]


def test_no_motion_is_refused_to_fit_and_warned_of_to_hold_out():
    good = log()
    still = changed(
        good, **{n: v.mean() + 0.01 * (v - v.mean()) for n, v in good.columns.items()}
    )
    told = only(still, "excitation", "refuse").text
    assert "0.05 rad" in told and "livelier" in told and "units" not in told
    small = {name: np.deg2rad(v) for name, v in good.columns.items()
             if name.startswith("position.")}  # fmt: skip
    told = only(changed(good, **small), "excitation", "refuse").text
    assert "times as far" in told and "check the units" in told
    only(still, "excitation", "warning", role="held-out")
    ramp = {name: np.linspace(0.0, 0.9, len(good.time)) for name in good.columns}
    assert "0 reversals" in only(changed(good, **ramp), "excitation", "refuse").text
    short = only(log(seconds=1.8), "excitation", "refuse")
    assert "2 s" in short.text


def test_one_lame_joint_is_only_warned_of():
    good = log()
    weak = 0.8 + 0.04 * (good.columns["position.knee"] - 0.8)
    lame = changed(good, **{"position.knee": STEP * np.round(weak / STEP)})
    assert list(only(lame, "excitation", "warning").values) == ["knee"]


def test_saturation_and_commands_beyond_the_limits_name_their_row():
    good = log()
    top = 1.0
    command = good.columns["command.knee"]
    row = int(np.flatnonzero(command > top + 0.01)[0]) + 1
    clipped = np.minimum(good.columns["position.knee"], top)
    stopped = changed(good, **{"position.knee": clipped})
    ranges = {**RANGES, "knee": (-0.3, top)}
    assert f"row {row}, " in only(stopped, "limits", "warning", ranges=ranges).text
    assert "position.knee" in only(stopped, "saturation", "warning", ranges=ranges).text
    assert found(stopped, "saturation") == []


def test_start_in_motion_is_warned_of():
    whole = log()
    late = Recording(
        "late.csv",
        whole.time[300:] - whole.time[300],
        whole.trajectory[300:],
        {
            **{name: values[300:] for name, values in whole.columns.items()},
            "position.hip": whole.columns["position.hip"][300:]
            - np.linspace(0.0, 9.0, len(whole.time) - 300),
        },
        {},
    )
    assert "row 1, column 'position.hip'" in found(late, "start")[0].text
    offset = changed(whole, **{"position.hip": whole.columns["position.hip"] + 0.3})
    assert "from its command" in only(offset, "start", "warning").text


def test_positions_that_come_before_their_commands_are_told():
    good = log(delay=0.03)
    sides = "command", "position"
    turned = {
        f"{side}.{joint}": good.columns[f"{other}.{joint}"]
        for joint in JOINTS
        for side, other in (sides, sides[::-1])
    }
    told = only(changed(good, **turned), "delay", "warning")
    assert told.text.endswith("are commands and positions swapped?")
    assert told.values["hip"] == pytest.approx(-0.03, abs=0.005)


def test_turned_sign_swapped_columns_and_shift_are_refused():
    good = log()
    mean = good.columns["position.hip"].mean()
    turned = changed(good, **{"position.hip": 2 * mean - good.columns["position.hip"]})
    assert "sign: -1" in only(turned, "sign", "refuse").text
    hip, knee = (good.columns[f"position.{joint}"] for joint in JOINTS)
    swapped = changed(good, **{"position.hip": knee, "position.knee": hip})
    assert "command.knee" in found(swapped, "swapped")[0].text
    assert [each.level for each in found(swapped, "swapped")] == ["refuse"] * 2
    shifted = found(log(delay=0.45), "shifted")
    assert [each.level for each in shifted] == ["refuse"] * 2
    assert shifted[0].values["hip"] == pytest.approx(0.45, abs=0.011)
    early = found(log(delay=-0.12), "shifted")
    assert [each.level for each in early] == ["warning"] * 2
    ahead = found(log(delay=-0.4), "shifted")
    assert [each.level for each in ahead] == ["refuse"] * 2
    assert early[0].values["hip"] == pytest.approx(-0.12, abs=0.011)
    assert found(log(delay=0.1), "shifted") == []


def test_a_servo_that_lags_long_is_no_clock_that_differs():
    time = np.arange(0.0, 20.0, 0.02)
    command = 0.6 * np.sin(2 * np.pi * 0.3 * time) + 0.1 * np.sin(2.2 * time)
    keep = np.exp(-0.02 / 0.6)  # 0.6 s
    position = lfilter([1.0 - keep], [1.0, -keep], command)
    columns = {"command.hip": command, "position.hip": position}
    late = Recording("late.csv", time, np.zeros(len(time), int), columns, {})
    (found_late,) = found(late, "shifted")
    assert found_late.level == "warning" and "a slow servo, or" in found_late.text
    moved = np.interp(time - 0.6, time, command)
    (moved,) = found(changed(late, **{"position.hip": moved}), "shifted")
    assert moved.level == "refuse" and "different clocks" in moved.text


def test_clock_that_drifts_is_not_refused():
    good = log(seconds=16.0)
    for drift in (0.05, -0.05, 0.02):
        late = {
            name: np.interp((1.0 - drift) * good.time, good.time, values)
            for name, values in good.columns.items()
            if name.startswith("position")
        }
        levels = {each.level for each in findings(changed(good, **late), RANGES, "fit")}
        assert "refuse" not in levels


def test_shift_that_changes_within_the_log_is_told_from_a_constant_one():
    good = log(seconds=16.0)
    early, late = (log(seconds=16.0, delay=delay) for delay in (0.25, 0.42))
    half = len(good.time) // 2
    both = {
        f"position.{joint}": np.concatenate(
            [
                early.columns[f"position.{joint}"][:half],
                late.columns[f"position.{joint}"][half:],
            ]
        )
        for joint in JOINTS
    }
    every = found(changed(good, **both), "shifted")
    assert [each.level for each in every] == ["warning"] * len(every)
    assert all("run apart" in each.text for each in every) and every


def test_slow_log_with_play_is_no_shift():
    time = np.arange(0.0, 20.0, PERIOD)
    command = 0.4 * np.sin(2 * np.pi * 0.05 * time)
    position = 0.4 * np.sin(2 * np.pi * 0.05 * (time - 0.5))
    columns = {"command.hip": command, "position.hip": position}
    slow = Recording("slow.csv", time, np.zeros(len(time), int), columns, {})
    assert found(slow, "shifted") == []


@pytest.mark.parametrize("later", [0.0, 12.0037])
def test_repeats_are_compared(later):
    one, other = log(seed=0), log(seed=0)
    random = np.random.default_rng(9).normal(0.0, 0.02, len(one.time))
    columns = {
        name: np.concatenate([values, other.columns[name]])
        for name, values in one.columns.items()
    }
    columns["position.hip"][len(one.time) :] += random
    both = Recording(
        "two.csv",
        np.concatenate([one.time, other.time + later]),
        np.repeat([0, 1], len(one.time)),
        columns,
        {},
    )
    finding = only(both, "repeats", "info")
    assert finding.values["hip"] == pytest.approx(0.02, rel=0.1)
    assert finding.values["knee"] < 1e-3
    assert found(log(), "repeats") == []


def test_same_rows_are_found_under_another_name_and_other_rows_are_not():
    fit, held = log(seed=0), log(seed=1, name="held.parquet")
    assert same_data([fit], [held]) is None
    repeat = log(seed=0, name="again.parquet", delay=0.031)
    assert same_data([fit], [repeat]) is None
    part = slice(500, 800)
    copied = Recording(
        "other.csv",
        fit.time[part] - fit.time[part][0],
        fit.trajectory[part],
        {name: values[part].astype(np.float32) for name, values in fit.columns.items()},
        {},
    )
    line = same_data([held, fit], [copied])
    assert line is not None
    assert line.startswith("other.csv: rows 1 to 300 are also in fit.parquet")


def test_a_motion_that_repeats_itself_is_not_shifted():
    steady = log(seconds=30.0)
    time, draw = steady.time, np.random.default_rng(3)
    sent = {j: 0.3 * np.sin(2 * np.pi * (time + 0.1 * k)) for k, j in enumerate(JOINTS)}
    columns = {f"command.{j}": values for j, values in sent.items()}
    for j, values in sent.items():
        late = np.roll(values, 4) * (1.0 + 0.1 * np.sin(0.4 * time))
        columns[f"position.{j}"] = late + 5e-4 * draw.normal(size=len(time))
    found = findings(changed(steady, **columns), {}, "fit")
    assert "shifted" not in {each.check for each in found}


def test_motions_that_only_begin_alike_share_no_data():
    one, other = log(seed=0), log(seed=7, name="other.csv")
    alike = {
        name: np.concatenate([one.columns[name][:200], values[200:]])
        for name, values in other.columns.items()
    }
    assert same_data([one], [changed(other, **alike)]) is None


def test_summary_tells_many_findings_of_a_kind_by_their_number():
    one = Finding("warning", "starts", "moves", {})
    log = Recording("log", np.zeros(0), np.zeros(0, int), {}, {})
    rows = summary([(log, [one] * 9), (log._replace(name="other"), [one])])
    assert [row["text"] for row in rows] == [
        "moves", "moves", "moves (and 6 more of this kind)", "moves"
    ]  # fmt: skip


def test_summary_puts_the_gravest_first():
    good, bad = log(), log(delay=0.45, name="bad.csv")
    rows = summary([(each, findings(each, RANGES, "fit")) for each in (good, bad)])
    assert rows[0]["level"] == "refuse" and rows[0]["file"] == "bad.csv"
    assert set(rows[0]) == {"file", "level", "check", "text"}
    assert len(rows) == sum(len(findings(r, RANGES, "fit")) for r in (good, bad))
