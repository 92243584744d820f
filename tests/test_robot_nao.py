"""The NAO model against its published numbers, and against what nao.py derives."""

import json
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from mujoco import mjx

from gatjax.records import FORCE_SENSORS, JOINTS
from gatjax.robot import nao
from gatjax.robot.model import HUNG, check_walker, joint_names, load, slots
from gatjax.sim.limbs import put_down

# Numbers of the ros-naoqi URDF v5 and of B-Human's 2025 release: mass, m; centre of
# mass, m; inertia about it, kg m^2, xx yy zz xy xz yz.
LINKS = {
    "Head": (0.65937, (0.00109, 0.00146, 0.05719),
             (7.71814e-4, 6.8121e-4, 7.14707e-4,
              4.767e-6, 9.656e-6, -1.8718e-5)),
    "LThigh": (0.38968, (0.00138, 0.00221, -0.05373),
               (5.09844e-4, 4.65358e-4, 3.01098e-4,
                2.11296e-6, 5.64129e-5, -7.91029e-6)),
    "LTibia": (0.30142, (0.00453, 0.00225, -0.04936),
               (4.46171e-4, 3.88084e-4, 1.85516e-4,
                3.70584e-6, -3.09008e-5, 6.01953e-6)),
    "LFoot": (0.17184, (0.02542, 0.0033, -0.03239),
              (8.72911e-5, 3.53024e-4, 4.12846e-4,
               8.71925e-6, -2.10563e-6, 3.73459e-7)),
    "torso": (1.04956, (-0.00413, 0.0, 0.04342),
              (3.08361e-3, 2.8835e-3, 1.5924e-3,
               1.43116e-5, -3.30211e-5, -2.70793e-5)),
}  # fmt: skip
# Left sole, seen from the ankle, m (B-Human, counter-clockwise).
SOLE = np.array([
    (0.00897, -0.03318), (0.0577, -0.03877), (0.07395, -0.03729), (0.08765, -0.03148),
    (0.09687, -0.0188), (0.09942, -0.01015), (0.09899, 0.00869), (0.094, 0.02418),
    (0.08454, 0.0361), (0.06568, 0.04615), (0.04991, 0.04818), (0.00956, 0.03881),
    (-0.00842, 0.03954), (-0.02199, 0.04758), (-0.03125, 0.05002), (-0.04905, 0.0376),
    (-0.05072, -0.02138), (-0.04262, -0.0306), (-0.03297, -0.03435),
    (-0.00901, -0.03272),
])  # fmt: skip
ANKLE_OVER_SOLE = 0.04519
MIRROR = np.array([1.0, -1.0, 1.0])


@pytest.fixture(scope="module")
def model():
    return load()


def inertia(model, name):
    """Tensor about the centre of mass in the axes of the link."""
    body = model.body(name).id
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    turn = turn.reshape(3, 3)
    return turn @ np.diag(model.body_inertia[body]) @ turn.T


def motors(name):
    """Joints that the motor of an actuator moves."""
    return (name, "RHipYawPitch") if name == "LHipYawPitch" else (name,)


def inside(point, outline):
    """Whether a ray from a point to +x crosses a polygon's edges an odd number."""
    x, y = point
    first, last = outline, np.roll(outline, -1, axis=0)
    spans = (first[:, 1] > y) != (last[:, 1] > y)
    rise = np.where(spans, last[:, 1] - first[:, 1], 1.0)
    at = first[:, 0] + (y - first[:, 1]) * (last[:, 0] - first[:, 0]) / rise
    return np.count_nonzero(spans & (x < at)) % 2 == 1


def stand(model, seconds, push=None):
    """Stand in READY for some seconds, `push` being {body: force in N}."""
    data = mujoco.MjData(model)
    angle = dict.fromkeys(JOINTS, 0.0)
    for side in "LR":
        angle[f"{side}HipPitch"] = -0.36
        angle[f"{side}KneePitch"] = 0.86
        angle[f"{side}AnklePitch"] = -0.50
        angle[f"{side}ShoulderPitch"] = 1.5
    target = np.clip([angle[name] for name in JOINTS], nao.LOW, nao.HIGH)
    data.qpos[slots(model).position] = target
    data.qpos[2] = 0.315
    data.ctrl[:] = target
    for body, force in (push or {}).items():
        data.body(body).xfrc_applied[:3] = force
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return data


def test_the_model_fits_into_mjx(model):
    converted = mjx.put_model(model, impl="jax")
    assert converted.nu == 25
    assert converted.nv == model.nv == 6 + 26


def test_actuators_are_the_25_motors_in_order(model):
    assert joint_names(model) == JOINTS
    assert tuple(model.actuator(index).name for index in range(model.nu)) == JOINTS
    assert len(set(JOINTS)) == 25


def test_force_sensors_are_the_eight_corners_in_order(model):
    where = slots(model).force
    names = [
        model.sensor(int(np.flatnonzero(model.sensor_adr == place)[0])).name
        for place in where
    ]
    assert tuple(names) == FORCE_SENSORS


BIPED = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
<body name="torso" pos="0 0 3"><freejoint/><geom size="0.1"/>
  <site name="imu" euler="0 0 90" pos="0.02 0 0"/><site name="belly" size="0.1"/>
  <body name="leg" pos="0 0 -0.3"><joint name="hip" axis="0 1 0"/><geom size="0.05"/>
    <site name="sole" size="0.1" euler="10 0 0"/></body></body></worldbody>
<actuator><position joint="hip" kp="20"/></actuator>
<sensor><touch name="foot" site="sole"/><touch name="front" site="belly"/>
  <gyro site="imu"/></sensor></mujoco>"""


@pytest.fixture
def biped(tmp_path):
    (tmp_path / "biped.xml").write_text(BIPED)
    return load(tmp_path / "biped.xml")


def test_touch_sensors_are_in_the_order_of_the_model(biped):
    assert slots(biped).force.tolist() == biped.sensor_adr[:2].tolist()


def test_a_gyro_tells_the_torsos_axes_however_it_is_mounted(biped):
    data = mujoco.MjData(biped)
    data.qvel[3:6] = [0.1, 0.2, 0.3]
    mujoco.mj_forward(biped, data)
    np.testing.assert_allclose(data.sensordata[slots(biped).gyro], [0.1, 0.2, 0.3])
    assert abs(biped.site("sole").quat[1]) > 0.05  # others stay


def test_a_robot_is_put_down_from_wherever_it_is(biped):
    data = mujoco.MjData(biped)
    data.qpos[:] = put_down(biped, np.zeros(1))
    mujoco.mj_kinematics(biped, data)
    assert data.geom_xpos[2, 2] == pytest.approx(0.05)


@pytest.mark.parametrize("name", JOINTS)
def test_every_motor_is_the_one_that_the_datasheet_gives(model, name):
    motor, joints = nao.motor_of(name), motors(name)
    armature = sum(model.joint(joint).armature[0] for joint in joints)
    damping = sum(model.joint(joint).damping[0] for joint in joints)
    actuator = model.actuator(name)
    assert armature == pytest.approx(motor.armature, rel=1e-4)
    assert damping == pytest.approx(motor.damping, rel=1e-4)
    limits = (-motor.stall_torque, motor.stall_torque)
    assert actuator.forcerange == pytest.approx(limits, rel=1e-4)
    assert actuator.gainprm[0] == motor.gain
    assert actuator.biasprm[1] == -motor.gain
    assert actuator.biasprm[2] == 0.0  # the damping is the joint's


def test_the_one_hip_yaw_motor_is_shared_equally(model):
    left, right = model.joint("LHipYawPitch"), model.joint("RHipYawPitch")
    assert left.armature == right.armature
    assert left.damping == right.damping


def test_motors_turn_as_fast_and_as_strongly_as_published():
    """Gear and shaft of the NAO6 datasheet; 0.8 is the assumed efficiency."""
    knee, roll = nao.motor_of("LKneePitch"), nao.motor_of("RHipRoll")
    assert knee.no_load_speed == pytest.approx(6.96, abs=0.005)
    assert roll.no_load_speed == pytest.approx(4.53, abs=0.005)
    assert knee.stall_torque / nao.GEAR_EFFICIENCY == pytest.approx(8.5, abs=0.05)
    assert roll.stall_torque / nao.GEAR_EFFICIENCY == pytest.approx(13.1, abs=0.05)


@pytest.mark.parametrize("name", JOINTS)
def test_joint_and_command_limits_are_those_of_nao_py(model, name):
    limits = nao.LIMITS[JOINTS.index(name)]
    for joint in motors(name):
        assert model.joint(joint).limited[0]
        assert model.joint(joint).range == pytest.approx(limits, abs=1e-5)
    assert model.actuator(name).ctrlrange == pytest.approx(limits, abs=1e-5)


def test_an_unknown_joint_is_named_with_those_that_exist():
    with pytest.raises(ValueError, match=r"'LKnee' is unknown; .*'LKneePitch'"):
        nao.motor_of("LKnee")


def test_total_mass_is_the_sum_of_the_published_links(model):
    # The URDF rounds links to 0.01 g, so its sum is not B-Human's to the last digit.
    assert model.body_mass.sum() == pytest.approx(nao.TOTAL_MASS, abs=1e-4)


@pytest.mark.parametrize("name", LINKS)
def test_links_have_the_published_mass_and_inertia_about_their_centre(model, name):
    mass, centre, (xx, yy, zz, xy, xz, yz) = LINKS[name]
    published = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    assert model.body(name).mass[0] == pytest.approx(mass, rel=1e-5)
    assert model.body(name).ipos == pytest.approx(centre, abs=1e-7)
    np.testing.assert_allclose(inertia(model, name), published, rtol=0, atol=2e-9)


def test_every_inertia_is_that_of_a_body_with_positive_density(model):
    moments = model.body_inertia[1:]
    assert (moments > 0.0).all()
    assert (moments.sum(1) >= 2.0 * moments.max(1)).all()


@pytest.mark.parametrize("link, length", [("Thigh", 0.1), ("Tibia", 0.1029)])
@pytest.mark.parametrize("side", "LR")
def test_leg_inertia_is_not_about_the_joint(model, side, link, length):
    """Mass inside a link of this length can't have a larger radius of gyration."""
    name = side + link
    radius = np.sqrt(inertia(model, name)[1, 1] / model.body(name).mass[0])
    assert radius < 0.5 * length


def test_left_and_right_limbs_mirror_each_other(model):
    for index in range(1, model.nbody):
        left = model.body(index)
        if not left.name.startswith("L"):
            continue
        right = model.body("R" + left.name[1:])
        assert right.mass == left.mass, left.name
        assert right.pos == pytest.approx(MIRROR * left.pos), left.name
        assert right.ipos == pytest.approx(MIRROR * left.ipos), left.name


def test_mirrored_angles_mirror_the_pose(model):
    """Yaw and roll change sign with the side, pitch does not."""
    generator = np.random.default_rng(0)
    left, right = mujoco.MjData(model), mujoco.MjData(model)
    for data in (left, right):
        data.qpos[3] = 1.0
    for index in range(1, model.njnt):
        name = model.joint(index).name
        if name.startswith("R"):
            continue
        angle = generator.uniform(-0.5, 0.5)
        flip = -1.0 if name.endswith(("Yaw", "Roll")) else 1.0
        twin = "R" + name[1:] if name.startswith("L") else name
        left.joint(name).qpos = angle
        right.joint(twin).qpos = flip * angle
        if twin != name:
            other = generator.uniform(-0.5, 0.5)
            left.joint(twin).qpos = other
            right.joint(name).qpos = flip * other
    mujoco.mj_kinematics(model, left)
    mujoco.mj_kinematics(model, right)
    for index in range(1, model.nbody):
        name = model.body(index).name
        twin = {"L": "R", "R": "L"}.get(name[0], name[0]) + name[1:]
        mirrored = MIRROR * right.body(twin).xpos
        assert left.body(name).xpos == pytest.approx(mirrored, abs=1e-9), name


@pytest.mark.parametrize("side", "LR")
def test_sole_corners_lie_inside_the_published_outline(model, side):
    outline = SOLE if side == "L" else SOLE * [1.0, -1.0]
    corners = [name for name in FORCE_SENSORS if name.startswith(side)]
    points = np.array([model.geom(name).pos for name in corners])
    for name, point in zip(corners, points, strict=True):
        assert inside(point[:2], outline), name
    assert np.ptp(points[:, 0]) > 0.1  # and reach towards its ends
    assert np.ptp(points[:, 1]) > 0.06
    radius = model.geom(corners[0]).size[0]
    assert points[:, 2] - radius == pytest.approx(-ANKLE_OVER_SOLE, abs=1e-6)
    for name in corners:
        assert model.site(name).pos == pytest.approx(model.geom(name).pos), name
        forward, left = "Front" in name, name.endswith("Left")
        x, y = model.geom(name).pos[:2]
        assert (x > 0.0) == forward
        assert (y > 0.0) == left


def test_only_the_soles_touch_the_floor(model):
    touching = {
        model.geom(index).name
        for index in range(model.ngeom)
        if model.geom_contype[index] or model.geom_conaffinity[index]
    }
    assert touching == {"floor", *FORCE_SENSORS}


def test_it_stands_still_and_its_soles_carry_its_weight(model):
    data = stand(model, 3.0)
    where = slots(model)
    weight = model.body_mass.sum() * 9.81
    force = data.sensordata[where.force]
    assert data.qpos[2] == pytest.approx(0.3137, abs=1e-3)
    assert abs(data.qvel).max() < 1e-3
    assert force.min() > 0.0
    assert force.sum() == pytest.approx(weight, rel=1e-4)
    assert data.sensordata[where.accelerometer] == pytest.approx((0, 0, 9.81), abs=0.05)
    assert data.sensordata[where.gyro] == pytest.approx(np.zeros(3), abs=1e-3)


def test_the_hip_yaw_joints_stay_equal_under_load(model):
    """Pushing the feet apart loads both; the soft equality gives way by little."""
    data = stand(model, 1.5, push={"LFoot": (0.0, 0.0, 12.0), "torso": (4.0, 4.0, 0.0)})
    left, right = (data.joint(f"{side}HipYawPitch").qpos[0] for side in "LR")
    assert abs(left) > 2e-3  # there is a load
    assert abs(left - right) < nao.ENCODER_STEP  # no real sensor sees more


def test_the_models_names_and_the_error_for_a_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="give an MJCF file"):
        load(tmp_path / "none.xml")
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody></mujoco>")
    with pytest.raises(ValueError, match=r"broken\.xml is not a valid MJCF model"):
        load(tmp_path / "broken.xml")


@pytest.mark.parametrize("module", [
    "gatjax.robot.nao", "gatjax.walk.gait", "gatjax.task", "gatjax.effects.catalogue",
    "gatjax.effects.sensor", "gatjax.data.recording", "gatjax.data.mapping",
    "gatjax.records", "gatjax.xp",
])  # fmt: skip
def test_what_runs_on_the_robot_loads_neither_jax_nor_mujoco(module):
    program = (
        f"import sys, json, {module};"
        "print(json.dumps(sorted({name.partition('.')[0] for name in sys.modules})))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    loaded = set(json.loads(done.stdout))
    assert "gatjax" in loaded
    assert not loaded & {"jax", "jaxlib", "mujoco", "evosax", "flax", "optax", "orbax"}


def test_the_hung_nao_is_the_same_robot_with_its_torso_held(model):
    hung = load(HUNG)
    assert (hung.nq, hung.nv) == (model.nq - 7, model.nv - 6)
    assert joint_names(hung) == JOINTS
    np.testing.assert_array_equal(hung.body_mass, model.body_mass)
    np.testing.assert_array_equal(hung.actuator_gainprm, model.actuator_gainprm)
    data = mujoco.MjData(hung)
    data.qpos[slots(hung).position] = nao.LIMITS[:, 1]
    mujoco.mj_forward(hung, data)
    soles = [hung.geom(name).id for name in FORCE_SENSORS]
    assert data.geom_xpos[soles, 2].min() > 1.0


def test_a_nao_that_hangs_cannot_walk(model):
    check_walker(model, "nao")
    with pytest.raises(ValueError, match="hangs and cannot walk; use a world of the"):
        check_walker(load(HUNG), HUNG)
