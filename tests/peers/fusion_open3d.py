"""TSDF integration of real frames: glint's crate `fusion` against Open3D, same threads, in one run.

    python3 tests/peers/fusion_open3d.py [REDKITCHEN] [--voxel-mm 5] [--threads 1] [--rounds 3]
                                         [--least-ratio 8]

Both fuse frames 122-221 with the given poses, depth only, truncation 8 voxels. The two take turns `--rounds`
times on the same cores; CPU time is compared (the machine may be busy), each side's best round counts.
Open3D: compute_unique_block_coordinates + integrate on a t.geometry.VoxelBlockGrid of 16^3 blocks, tsdf and
weight f32, OMP_NUM_THREADS as asked; depth images are converted before the clock starts, as the Rust side's
are. The Rust side is the example `fuse_folder`, built here by cargo.
Exit: 0 when the ratio is reached or a tool is absent (said by name), 1 otherwise.
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
FRAMES = range(122, 222)
TRUNCATION_VOXELS = 8.0
DEPTH_MAX = 4.0
INVALID = 65535
HEADER = struct.Struct("<III4d")


def skip(reason):
    print(f"SKIPPED fusion_open3d: {reason}")
    sys.exit(0)


try:
    import numpy as np
    import open3d as o3d
    from PIL import Image
except ImportError as error:
    skip(f"python package {error.name} is absent (pip install open3d==0.20.0 numpy pillow)")


def write_dump(path, folder):
    """The format that `fuse_folder` documents."""
    k = np.loadtxt(folder / "camera-intrinsics.txt")
    with open(path, "wb") as out:
        for number in FRAMES:
            stem = folder / f"frame-{number:06d}"
            depth = np.asarray(Image.open(f"{stem}.depth.png")).astype(np.uint16)
            if number == FRAMES.start:
                height, width = depth.shape
                out.write(HEADER.pack(width, height, len(FRAMES), k[0, 0], k[1, 1], k[0, 2], k[1, 2]))
            out.write(np.loadtxt(f"{stem}.pose.txt").astype("<f8").tobytes())
            out.write(np.where(depth == INVALID, 0, depth).astype("<u2").tobytes())
            out.write(np.asarray(Image.open(f"{stem}.color.jpg").convert("RGB")).astype("u1").tobytes())


def read_dump(path):
    with open(path, "rb") as dump:
        width, height, count, fx, fy, cx, cy = HEADER.unpack(dump.read(HEADER.size))
        frames = []
        for _ in range(count):
            pose = np.frombuffer(dump.read(128), "<f8").reshape(4, 4)
            frames.append((pose, np.frombuffer(dump.read(2 * width * height), "<u2").reshape(height, width)))
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), frames


def run_open3d(dump, voxel_mm):
    """Runs in a process of its own, so that OMP_NUM_THREADS and the affinity hold; prints one line of JSON."""
    k, frames = read_dump(dump)
    core = o3d.core
    grid = o3d.t.geometry.VoxelBlockGrid(
        attr_names=("tsdf", "weight"),
        attr_dtypes=(core.float32, core.float32),
        attr_channels=((1), (1)),
        voxel_size=voxel_mm / 1000.0,
        block_resolution=16,
        block_count=50_000,
        device=core.Device("CPU:0"),
    )
    intrinsic = core.Tensor(k, core.float64)
    inputs = [
        (o3d.t.geometry.Image(core.Tensor(depth.copy())), core.Tensor(np.linalg.inv(pose), core.float64))
        for pose, depth in frames
    ]
    times = []
    for depth, camera_from_world in inputs:
        start = time.process_time()
        blocks = grid.compute_unique_block_coordinates(
            depth, intrinsic, camera_from_world, 1000.0, DEPTH_MAX, TRUNCATION_VOXELS
        )
        grid.integrate(blocks, depth, intrinsic, camera_from_world, 1000.0, DEPTH_MAX, TRUNCATION_VOXELS)
        times.append(time.process_time() - start)
    print(json.dumps({"core_ms_total": sum(times) * 1e3, "blocks": int(grid.hashmap().size())}))


def last_line_of(command, threads):
    environment = dict(os.environ, OMP_NUM_THREADS=str(threads))
    output = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
    return json.loads(output.strip().splitlines()[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", default=str(ROOT.parent / "shared/data/redkitchen"))
    parser.add_argument("--voxel-mm", type=float, default=5.0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--least-ratio", type=float, default=8.0)
    parser.add_argument("--open3d-on", metavar="DUMP", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.open3d_on:
        return run_open3d(arguments.open3d_on, arguments.voxel_mm)
    folder = pathlib.Path(arguments.folder)
    if not (folder / "camera-intrinsics.txt").exists():
        skip(f"no redkitchen frames in {folder}")
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) < arguments.threads:
        skip(f"{arguments.threads} threads asked, {len(cores)} cores here")
    subprocess.run(["cargo", "build", "-q", "--release", "-p", "fusion", "--example", "fuse_folder"],
                   check=True, cwd=ROOT)
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    # For this process and all that it starts.
    os.sched_setaffinity(0, set(cores[: arguments.threads]))
    ours, theirs = [], []
    with tempfile.TemporaryDirectory() as scratch:
        dump = os.path.join(scratch, "frames.bin")
        write_dump(dump, folder)
        voxel = ["--voxel-mm", str(arguments.voxel_mm)]
        fuse = [str(target / "release/examples/fuse_folder"), dump, *voxel,
                "--truncation-voxels", str(TRUNCATION_VOXELS), "--threads", str(arguments.threads)]
        open3d = [sys.executable, __file__, "--open3d-on", dump, *voxel]
        for _ in range(arguments.rounds):
            ours.append(last_line_of(fuse, arguments.threads))
            theirs.append(last_line_of(open3d, arguments.threads))
    best_ours = min(ours, key=lambda r: r["core_ms_total"])
    best_theirs = min(theirs, key=lambda r: r["core_ms_total"])
    ratio = best_theirs["core_ms_total"] / best_ours["core_ms_total"]
    count = len(FRAMES)
    print(f"redkitchen {FRAMES.start}-{FRAMES.stop - 1}, {arguments.voxel_mm:g} mm, truncation "
          f"{TRUNCATION_VOXELS:g} voxels, depth only, {arguments.threads} thread(s), best of {arguments.rounds}, "
          f"load {os.getloadavg()[0]:.1f}")
    print(f"  fusion        {best_ours['core_ms_total'] / count:8.2f} core-ms per frame, "
          f"{best_ours['blocks']} blocks of 8^3")
    print(f"  open3d {o3d.__version__} {best_theirs['core_ms_total'] / count:8.2f} core-ms per frame, "
          f"{best_theirs['blocks']} blocks of 16^3")
    print(f"  ratio {ratio:.2f} (needed {arguments.least_ratio:g})")
    sys.exit(0 if ratio >= arguments.least_ratio else 1)


if __name__ == "__main__":
    main()
