#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The images of a folder per camera as recordings of every kind, written by the Python packages of the formats' authors.

    pip install mcap mcap-ros2-support rosbags opencv-python-headless
    write_recordings.py IMAGES OUT [--interval 0.1] [--jitter 0.0005] [--encoding mono8]

IMAGES/left/0001.png, ..., IMAGES/right/0001.png, ..., whose numbers are counted in intervals, become OUT/zstd.mcap, OUT/lz4.mcap, OUT/plain.mcap, OUT/png.mcap (image files in
messages), OUT/ros2 (mcap_ros2), OUT/db3, OUT/db3_packed, OUT/ros2_mcap (folders of ROS 2), OUT/plain.bag, OUT/lz4.bag,
OUT/bz2.bag, and OUT/left.avi, OUT/right.avi (lossless). Topics /left/image_raw, /left/camera_info, ... and one without
images, /imu.
"""
import argparse
import pathlib
import random
import shutil

import cv2
import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer as Ros2Writer
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

START_NS = 1_700_000_000_000_000_000
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
CONVERSIONS = {"mono8": None, "bgr8": cv2.COLOR_GRAY2BGR, "rgb8": cv2.COLOR_GRAY2RGB, "mono16": None}


class Messages:
    """The messages of a rig in the order of their times."""

    def __init__(self, folder, args):
        random.seed(1)
        self.items = []  # (log time, topic, type name, fields)
        cameras = sorted(path for path in folder.iterdir() if path.is_dir())
        for camera in cameras:
            for i, file in enumerate(sorted(camera.glob("*.png"))):
                time = args.interval * int(file.stem) + random.gauss(0, args.jitter)
                stamp = START_NS + round(1e9 * time)
                logged = stamp + random.randrange(1_000_000, 5_000_000)
                self.items.append((logged, f"/{camera.name}/image_raw", "Image", (stamp, camera.name, file)))
                if i == 0:
                    self.items.append((logged, f"/{camera.name}/camera_info", "CameraInfo", (stamp, camera.name, file)))
                self.items.append((logged + 1, "/imu", "Imu", (stamp, camera.name, file)))
        self.items.sort(key=lambda item: item[0])
        self.args = args

    def message(self, store, kind, fields, as_files):
        stamp, frame, file = fields
        types, ros1 = store.types, store is ROS1
        time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        more = {"seq": 0} if ros1 else {}
        header = types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **more)
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        height, width = image.shape[:2]
        if kind == "Imu":
            vector = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=9.81)
            rotation = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
            nine = np.zeros(9)
            return types["sensor_msgs/msg/Imu"](header, rotation, nine, vector, nine, vector, nine)
        if kind == "CameraInfo":
            roi = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
            f, x, y = 1.1 * width, width / 2, height / 2
            K, R = np.array([f, 0, x, 0, f, y, 0, 0, 1.0]), np.eye(3).ravel()
            P = np.array([f, 0, x, 0, 0, f, y, 0, 0, 0, 1.0, 0])
            return types["sensor_msgs/msg/CameraInfo"](header, height, width, "plumb_bob", np.zeros(5), K, R, P, 0, 0, roi)
        if as_files:
            return types["sensor_msgs/msg/CompressedImage"](header, "png", np.fromfile(file, np.uint8))
        encoding = self.args.encoding
        if image.ndim == 3 and encoding == "mono8":
            encoding = "bgr8"
        elif CONVERSIONS.get(encoding) is not None:
            image = cv2.cvtColor(image, CONVERSIONS[encoding])
        elif encoding == "mono16":
            image = image.astype(np.uint16)
        data = np.frombuffer(image.tobytes(), np.uint8)
        return types["sensor_msgs/msg/Image"](header, height, width, encoding, 0, image.strides[0], data)


def type_name(kind, as_files):
    return "sensor_msgs/msg/" + ("CompressedImage" if kind == "Image" and as_files else kind)


def write_mcap(path, messages, compression, as_files=False):
    with open(path, "wb") as file:
        writer = McapWriter(file, compression=compression, chunk_size=1 << 20)
        writer.start(profile="ros2", library="write_recordings")
        channels = {}
        for logged, topic, kind, fields in messages.items:
            name = type_name(kind, as_files)
            if topic not in channels:
                schema = writer.register_schema(name, "ros2msg", ROS2.generate_msgdef(name, ros_version=2)[0].encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = ROS2.serialize_cdr(messages.message(ROS2, kind, fields, as_files), name)
            writer.add_message(channels[topic], logged, bytes(data), logged)
        writer.finish()


def write_mcap_ros2(path, messages):
    """By the ROS 2 package of MCAP, which serialises messages itself."""
    with open(path, "wb") as file:
        writer = Ros2Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/Image", ROS2.generate_msgdef("sensor_msgs/msg/Image", ros_version=2)[0])
        for logged, topic, kind, fields in messages.items:
            if kind != "Image":
                continue
            image = messages.message(ROS2, kind, fields, False)
            stamp = {"sec": image.header.stamp.sec, "nanosec": image.header.stamp.nanosec}
            writer.write_message(
                topic, schema,
                {"header": {"stamp": stamp, "frame_id": image.header.frame_id}, "height": image.height,
                 "width": image.width, "encoding": image.encoding, "is_bigendian": 0, "step": image.step,
                 "data": image.data.tobytes()}, logged, logged)
        writer.finish()


def write_ros2(path, messages, plugin, packed=False):
    bag = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    if packed:
        bag.set_compression(rosbag2.CompressionMode.MESSAGE, rosbag2.CompressionFormat.ZSTD)
    with bag as writer:
        connections = {}
        for logged, topic, kind, fields in messages.items:
            name = type_name(kind, False)
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=ROS2)
            writer.write(connections[topic], logged, ROS2.serialize_cdr(messages.message(ROS2, kind, fields, False), name))


def write_bag(path, messages, compression):
    bag = rosbag1.Writer(path)
    if compression:
        bag.set_compression(compression)
    with bag as writer:
        connections = {}
        for logged, topic, kind, fields in messages.items:
            name = type_name(kind, False)
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=ROS1)
            writer.write(connections[topic], logged, ROS1.serialize_ros1(messages.message(ROS1, kind, fields, False), name))


def write_videos(folder, out, interval):
    for camera in sorted(path for path in folder.iterdir() if path.is_dir()):
        video = None
        for file in sorted(camera.glob("*.png")):
            image = cv2.imread(str(file), cv2.IMREAD_COLOR)
            if video is None:
                size = (image.shape[1], image.shape[0])
                video = cv2.VideoWriter(str(out / f"{camera.name}.avi"), cv2.VideoWriter_fourcc(*"FFV1"), 1 / interval, size)
            video.write(image)
        video.release()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("images", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--interval", type=float, default=0.1, help="s")
    parser.add_argument("--jitter", type=float, default=0.0005, help="s, sigma of each stamp")
    parser.add_argument("--encoding", default="mono8", choices=CONVERSIONS)
    args = parser.parse_args()
    shutil.rmtree(args.out, ignore_errors=True)
    args.out.mkdir(parents=True)
    messages = Messages(args.images, args)
    for name, compression in (("plain", CompressionType.NONE), ("lz4", CompressionType.LZ4), ("zstd", CompressionType.ZSTD)):
        write_mcap(args.out / f"{name}.mcap", messages, compression)
    write_mcap(args.out / "png.mcap", messages, CompressionType.NONE, as_files=True)
    write_mcap_ros2(args.out / "ros2.mcap", messages)
    write_ros2(args.out / "db3", messages, rosbag2.StoragePlugin.SQLITE3)
    write_ros2(args.out / "db3_packed", messages, rosbag2.StoragePlugin.SQLITE3, packed=True)
    write_ros2(args.out / "ros2_mcap", messages, rosbag2.StoragePlugin.MCAP)
    write_bag(args.out / "plain.bag", messages, None)
    for compression in rosbag1.Writer.CompressionFormat:
        write_bag(args.out / f"{compression.name.lower()}.bag", messages, compression)
    write_videos(args.images, args.out, args.interval)


if __name__ == "__main__":
    main()
