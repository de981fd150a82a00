"""Reads an exported dataset with LeRobot's own reader, in an environment that has it.

`python benchmarks/experiments/lerobot_reader.py DATASET`, with LeRobot's Python: nothing of TAMS is
imported. Every frame is read, with all its views; then windows in time, and batches in any order.
"""

from __future__ import annotations

import argparse
from importlib.metadata import version
from pathlib import Path

import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", type=Path)
    root = parser.parse_args().dataset
    dataset = LeRobotDataset("local/tams", root=root)
    print(", ".join(f"{name} {version(name)}" for name in ("lerobot", "torch", "datasets")))
    cameras = dataset.meta.camera_keys
    for number in range(len(dataset)):
        item = dataset[number]  # FrameTimestampError: a view has no frame at that time
        assert item["index"] == number
        assert all(item[camera].shape[0] == 3 for camera in cameras)
    print(f"{len(dataset)} items of {dataset.num_episodes} episodes, views {', '.join(cameras)}")
    print({name: getattr(value, "shape", value) for name, value in item.items()})

    period_s = 1 / dataset.fps
    offsets = {
        "action": [step * period_s for step in range(8)],
        **{camera: [-period_s, 0.0] for camera in cameras},
    }
    windows = LeRobotDataset("local/tams", root=root, delta_timestamps=offsets)
    batches = torch.utils.data.DataLoader(windows, batch_size=8, shuffle=True)
    count = sum(len(batch["index"]) for batch in batches)
    assert count == len(dataset)
    print(f"{count} windows of 8 actions and 2 frames, in batches of any order")
    for episode in dataset.meta.episodes:
        alone = LeRobotDataset("local/tams", root=root, episodes=[episode["episode_index"]])
        assert len(alone) == episode["length"]
        print(f"{episode['session']}: {len(alone)} items, success {episode['success']}")


if __name__ == "__main__":
    main()
