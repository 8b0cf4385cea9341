"""Tracking of real frames: glint's crate `fusion` against Open3D's frame-to-model SLAM, one core, in one run.

    python3 tests/peers/tracking_open3d.py [REDKITCHEN] [--voxel-mm 5] [--frames 100] [--rounds 2]

Both start at the first pose of the folder and track and fuse frames 0 to N-1 by themselves. What finds a pose is
compared: Open3D's track_frame_to_model (iterations 6, 3, 1 as it comes), without its prediction of the model, against
glint's prediction, alignment, starts, photometry and verdict. What is made of a frame before (points, luminance) is
left out on both sides. CPU time; the two take turns, each side's best round counts. The trajectory error is that after
rigid alignment with the folder's poses.
Open3D: t.pipelines.slam.Model, block resolution 16, truncation 8 voxels, depth difference 0.07 m.
Exit: 0 when glint tracks 4 times faster and no less accurately, or a tool is absent (said by name), 1 otherwise.
"""

import argparse
import json
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
LEAST_RATIO = 4.0
DEPTH_MAX = 4.0
INVALID = 65535
# Colour camera of the recording, estimated (its README): f, cx, cy, and where it sits.
COLOR = (521.8, 521.8, 318.6, 235.5)
COLOR_FROM_DEPTH = (-0.0244, 0.008, 0.0)


def skip(reason):
    print(f"SKIPPED tracking_open3d: {reason}")
    sys.exit(0)


try:
    import numpy as np
    import open3d as o3d
    from PIL import Image
except ImportError as error:
    skip(f"python package {error.name} is absent (pip install open3d==0.20.0 numpy pillow)")


def frames_of(folder, count):
    for number in range(count):
        stem = folder / f"frame-{number:06d}"
        depth = np.asarray(Image.open(f"{stem}.depth.png")).astype(np.uint16)
        color = np.asarray(Image.open(f"{stem}.color.jpg").convert("RGB"))
        yield np.loadtxt(f"{stem}.pose.txt"), np.where(depth == INVALID, 0, depth).astype(np.uint16), color


def write_dump(path, folder, count):
    """The format that `track_dump` documents."""
    k = np.loadtxt(folder / "camera-intrinsics.txt")
    offset = np.eye(4)
    offset[:3, 3] = COLOR_FROM_DEPTH
    with open(path, "wb") as out:
        for number, (pose, depth, color) in enumerate(frames_of(folder, count)):
            height, width = depth.shape
            if number == 0:
                out.write(struct.pack("<4I5d", width, height, count, 1, k[0, 0], k[1, 1], k[0, 2], k[1, 2], 0.001))
                out.write(struct.pack("<2I4d", color.shape[1], color.shape[0], *COLOR))
                out.write(offset.astype("<f8").tobytes())
            out.write(struct.pack("<q", int(number * 1e9 / 30)))
            out.write(pose.astype("<f8").tobytes() + depth.astype("<u2").tobytes() + color.tobytes())


def trajectory_error_mm(reference, estimate):
    """Root mean square distance after the rigid alignment of Umeyama, mm."""
    r, e = np.array(reference), np.array(estimate)
    r0, e0 = r - r.mean(0), e - e.mean(0)
    u, _, vt = np.linalg.svd(r0.T @ e0)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    return 1e3 * float(np.sqrt(((r0 - e0 @ (u @ flip @ vt).T) ** 2).sum(1).mean()))


def run_open3d(folder, voxel_mm, count):
    """Runs in a process of its own, so that OMP_NUM_THREADS and the affinity hold; prints one line of JSON."""
    core, slam = o3d.core, o3d.t.pipelines.slam
    device = core.Device("CPU:0")
    k = core.Tensor(np.loadtxt(folder / "camera-intrinsics.txt"), core.float64)
    track_ms, reference, estimate = 0.0, [], []
    for number, (pose, depth, color) in enumerate(frames_of(folder, count)):
        if number == 0:
            at = core.Tensor(pose, core.float64)
            model = slam.Model(voxel_mm / 1000.0, 16, 50_000, at, device)
            frame = slam.Frame(*depth.shape, k, device)
            seen = slam.Frame(*depth.shape, k, device)
        frame.set_data_from_image("depth", o3d.t.geometry.Image(core.Tensor(depth.copy())))
        frame.set_data_from_image("color", o3d.t.geometry.Image(core.Tensor(color.copy())))
        if number > 0:
            start = time.process_time()
            result = model.track_frame_to_model(frame, seen, 1000.0, DEPTH_MAX, 0.07)
            track_ms += (time.process_time() - start) * 1e3
            at = at @ result.transformation
        model.update_frame_pose(number, at)
        model.integrate(frame, 1000.0, DEPTH_MAX, 8.0)
        model.synthesize_model_frame(seen, 1000.0, 0.3, DEPTH_MAX, 8.0, False)
        reference.append(pose[:3, 3])
        estimate.append(at.numpy()[:3, 3])
    print(json.dumps({"track_ms": track_ms / count, "ate_mm": trajectory_error_mm(reference, estimate)}))


def last_line_of(command):
    environment = dict(os.environ, OMP_NUM_THREADS="1")
    output = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
    return json.loads(output.strip().splitlines()[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", default=str(ROOT.parent / "shared/data/redkitchen"))
    parser.add_argument("--voxel-mm", type=float, default=5.0)
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--open3d-here", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    folder = pathlib.Path(arguments.folder)
    if not (folder / "camera-intrinsics.txt").exists():
        skip(f"no redkitchen frames in {folder}")
    if arguments.open3d_here:
        return run_open3d(folder, arguments.voxel_mm, arguments.frames)
    subprocess.run(["cargo", "build", "-q", "--release", "-p", "fusion", "--example", "track_dump"],
                   check=True, cwd=ROOT)
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    with tempfile.TemporaryDirectory() as scratch:
        dump = os.path.join(scratch, "frames.bin")
        write_dump(dump, folder, arguments.frames)
        voxel = ["--voxel-mm", str(arguments.voxel_mm)]
        sides = [
            [str(target / "release/examples/track_dump"), dump, *voxel, "--threads", "1"],
            [sys.executable, __file__, str(folder), "--open3d-here", *voxel, "--frames", str(arguments.frames)],
        ]
        best = [None, None]
        for _ in range(arguments.rounds):
            for side, command in enumerate(sides):
                report = last_line_of(command)
                if best[side] is None or report["track_ms"] < best[side]["track_ms"]:
                    best[side] = report
    ours, theirs = best
    ratio = theirs["track_ms"] / ours["track_ms"]
    print(f"redkitchen 0-{arguments.frames - 1}, {arguments.voxel_mm:g} mm, one core, best of {arguments.rounds}, load "
          f"{os.getloadavg()[0]:.1f}, open3d {o3d.__version__}")
    print(f"  tracking, core-ms a frame  fusion {ours['track_ms']:.2f}   open3d {theirs['track_ms']:.2f}   ratio "
          f"{ratio:.2f} (needed {LEAST_RATIO:g})")
    print(f"  trajectory error, mm       fusion {ours['ate_mm']:.2f}   open3d {theirs['ate_mm']:.2f}")
    sys.exit(0 if ratio >= LEAST_RATIO and ours["ate_mm"] <= theirs["ate_mm"] else 1)


if __name__ == "__main__":
    main()
