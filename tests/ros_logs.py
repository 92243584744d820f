"""ROS 2 logs as robots write them, made by the formats' own libraries."""

import numpy as np
from mcap_ros2.writer import Writer as McapWriter
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
JOINTS = ("hip", "Knöchel")
START = 1_700_000_000.0  # s, since 1970
SENT = np.arange(0.0, 2.0, 0.02)  # s, of commands
SEEN = np.arange(0.013, 2.0, 0.01)  # s, of joint states


def commands(time):
    """Commanded angles [2], rad."""
    return np.array([np.sin(3.0 * time), 0.5 * np.cos(time)])


def angles(time):
    """Measured angles [2], rad."""
    return np.array([np.sin(3.0 * time - 0.2), 0.5 * np.cos(time) + 0.01])


def header(time):
    """A header stamped at a time, s."""
    nanoseconds = round(time * 1e9)
    stamp = {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}
    return {"stamp": stamp, "frame_id": ""}


def messages(offset=0.0):
    """Topic, type, log time and content of every message, in the order of log time.

    Headers are `offset` s behind the log's clock.
    """
    out = []
    for time in SENT:
        said = {"layout": {"dim": [], "data_offset": 0}, "data": commands(time)}
        out.append(("/arm/commands", "std_msgs/msg/Float64MultiArray", time, said))
    for time in SEEN:
        said = {
            "header": header(START + time - offset), "name": list(JOINTS),
            "position": angles(time), "velocity": np.zeros(2), "effort": np.ones(2),
        }  # fmt: skip
        out.append(("/joint_states", "sensor_msgs/msg/JointState", time, said))
        out.append(("/imu", "sensor_msgs/msg/Imu", time, imu(time, offset)))
        out.append(("/chat", "std_msgs/msg/String", time, {"data": "hello"}))
    return sorted(out, key=lambda message: message[2])


def imu(time, offset):
    """A message of an inertial unit that turns about z at 0.3 rad/s."""

    def three(x, y, z):
        return {"x": x, "y": y, "z": z}

    nothing = np.zeros(9)
    return {
        "header": header(START + time - offset),
        "orientation": three(0.0, 0.0, 0.0) | {"w": 1.0},
        "orientation_covariance": nothing,
        "angular_velocity": three(0.0, 0.0, 0.3),
        "angular_velocity_covariance": nothing,
        "linear_acceleration": three(0.0, 0.0, 9.81),
        "linear_acceleration_covariance": nothing,
    }


def write_mcap(path, sent):
    """An MCAP file of messages."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        schemas = {}
        for topic, kind, time, said in sent:
            if kind not in schemas:
                text = STORE.generate_msgdef(kind, ros_version=2)[0]
                schemas[kind] = writer.register_msgdef(kind, text)
            logged = round((START + time) * 1e9)
            writer.write_message(topic, schemas[kind], _listed(said), logged, logged)
        writer.finish()
    return path


def _listed(said):
    """The same with lists for arrays."""
    if isinstance(said, dict):
        return {name: _listed(value) for name, value in said.items()}
    return said.tolist() if isinstance(said, np.ndarray) else said


def write_bag(path, sent):
    """A rosbag2 folder of messages."""
    with BagWriter(path, version=9) as bag:
        connections = {}
        for topic, kind, time, said in sent:
            if topic not in connections:
                added = bag.add_connection(topic, kind, typestore=STORE)
                connections[topic] = added
            raw = STORE.serialize_cdr(_typed(kind, said), kind)
            bag.write(connections[topic], round((START + time) * 1e9), raw)
    return path


def _typed(kind, said):
    """A message of rosbags' types from plain dicts."""
    forms = dict(STORE.fielddefs[kind][1])
    fields = {
        name: _typed(forms[name][1], value) if isinstance(value, dict) else value
        for name, value in said.items()
    }
    return STORE.types[kind](**fields)
