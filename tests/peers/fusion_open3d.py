"""Fusion of real frames: glint's crate `fusion` against Open3D, same threads, in one run.

    python3 tests/peers/fusion_open3d.py [REDKITCHEN] [--voxel-mm 5] [--threads 1] [--rounds 3]

Both fuse frames 122-221 with the given poses, truncation 8 voxels. Rows, each with the ratio it needs: depth
(allocation and integration), the same with colour, and the model predicted from each pose (vertex and normal) at
320x240 and at 640x480. Both sides' predictions know the frame's depth: Open3D bounds its rays by the blocks that the
depth meets, glint starts at the depth, as tracking does. The row "march" is glint's prediction without the depth.
Last the F-score at 5 mm of the two meshes of the depth run, 0.95 needed: points sampled on one mesh against the
surface of the other (against sampled points it would measure how dense they lie). Surface counts from three
observations: Open3D's weights count them, glint's are (1 m / z)^2 each, so 3 / z^2 at the median depth.
The two take turns `--rounds` times on the same cores; CPU time is compared (the machine may be busy), each
side's best round counts.
Open3D: compute_unique_block_coordinates + integrate on a t.geometry.VoxelBlockGrid of 16^3 blocks, tsdf,
weight and colour f32, ray_cast over the blocks of the frame, OMP_NUM_THREADS as asked; images are converted
before the clock starts, as the Rust side's are. The Rust side is the example `fuse_folder`, built here by cargo.
Exit: 0 when every bar is reached or a tool is absent (said by name), 1 otherwise.
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
F_SCORE_DISTANCE = 0.005
LEAST_F_SCORE = 0.95
# Name, flags of both sides, what is compared, ratio needed.
ROWS = [
    ("integrate depth", [], "core_ms_total", 10.0),
    ("integrate depth + colour", ["--color", "yes"], "core_ms_total", 8.0),
    ("predict 320x240", ["--predict", "320"], "predict_core_ms_total", 10.0),
    ("predict 640x480", ["--predict", "640"], "predict_core_ms_total", 10.0),
    ("march 320x240", ["--predict", "320"], "march_core_ms_total", 0.0),
]
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
            depth = np.frombuffer(dump.read(2 * width * height), "<u2").reshape(height, width)
            color = np.frombuffer(dump.read(3 * width * height), "u1").reshape(height, width, 3)
            frames.append((pose, depth, color))
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), frames


def run_open3d(dump, voxel_mm, has_color, predict_width, mesh):
    """Runs in a process of its own, so that OMP_NUM_THREADS and the affinity hold; prints one line of JSON."""
    k, frames = read_dump(dump)
    core = o3d.core
    names, dtypes, channels = ("tsdf", "weight"), (core.float32, core.float32), ((1), (1))
    if has_color:
        names, dtypes, channels = (*names, "color"), (*dtypes, core.float32), (*channels, (3))
    grid = o3d.t.geometry.VoxelBlockGrid(
        attr_names=names,
        attr_dtypes=dtypes,
        attr_channels=channels,
        voxel_size=voxel_mm / 1000.0,
        block_resolution=16,
        block_count=50_000,
        device=core.Device("CPU:0"),
    )
    intrinsic = core.Tensor(k, core.float64)
    inputs = [
        (
            o3d.t.geometry.Image(core.Tensor(depth.copy())),
            o3d.t.geometry.Image(core.Tensor(color.copy())) if has_color else None,
            core.Tensor(np.linalg.inv(pose), core.float64),
        )
        for pose, depth, color in frames
    ]
    height, width = frames[0][1].shape
    if predict_width:
        scale = predict_width / width
        seen = k * scale
        seen[:2, 2] = (k[:2, 2] + 0.5) * scale - 0.5
        seen[2, 2] = 1.0
        seen = core.Tensor(seen, core.float64)
        seen_size = (predict_width, round(height * scale))
    times, predict_times = [], []
    for depth, color, camera_from_world in inputs:
        start = time.process_time()
        blocks = grid.compute_unique_block_coordinates(
            depth, intrinsic, camera_from_world, 1000.0, DEPTH_MAX, TRUNCATION_VOXELS
        )
        images = (depth, color) if has_color else (depth,)
        grid.integrate(blocks, *images, intrinsic, camera_from_world, 1000.0, DEPTH_MAX, TRUNCATION_VOXELS)
        times.append(time.process_time() - start)
        if predict_width:
            start = time.process_time()
            grid.ray_cast(
                blocks, seen, camera_from_world, *seen_size, ["vertex", "normal"],
                1000.0, 0.3, DEPTH_MAX, 1.0, TRUNCATION_VOXELS,
            )
            predict_times.append(time.process_time() - start)
    if mesh:
        o3d.io.write_triangle_mesh(mesh, grid.extract_triangle_mesh(3.0).to_legacy())
    print(json.dumps({
        "core_ms_total": sum(times) * 1e3,
        "predict_core_ms_total": sum(predict_times) * 1e3,
        "march_core_ms_total": sum(predict_times) * 1e3,
        "blocks": int(grid.hashmap().size()),
    }))


def f_score(paths, distance):
    """Harmonic mean of the shares of points on each surface that lie within `distance` of the other surface."""
    meshes = [o3d.io.read_triangle_mesh(path) for path in paths]
    shares = []
    for one, other in (meshes, meshes[::-1]):
        o3d.utility.random.seed(1)
        points = np.asarray(one.sample_points_uniformly(300_000).points, dtype=np.float32)
        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(other))
        shares.append(float((scene.compute_distance(o3d.core.Tensor(points)).numpy() < distance).mean()))
    return 2.0 * shares[0] * shares[1] / max(sum(shares), 1e-12), shares


def median_depth(dump):
    """Metres."""
    depths = np.concatenate([depth[::8, ::8].ravel() for _, depth, _ in read_dump(dump)[1]])
    return float(np.median(depths[depths > 0])) / 1000.0


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
    parser.add_argument("--open3d-on", metavar="DUMP", help=argparse.SUPPRESS)
    parser.add_argument("--color", default="no", help=argparse.SUPPRESS)
    parser.add_argument("--predict", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--mesh", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.open3d_on:
        return run_open3d(arguments.open3d_on, arguments.voxel_mm, arguments.color == "yes", arguments.predict,
                          arguments.mesh)
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
    count = len(FRAMES)
    print(f"redkitchen {FRAMES.start}-{FRAMES.stop - 1}, {arguments.voxel_mm:g} mm, truncation "
          f"{TRUNCATION_VOXELS:g} voxels, {arguments.threads} thread(s), best of {arguments.rounds}, "
          f"load {os.getloadavg()[0]:.1f}, open3d {o3d.__version__}, core-ms per frame")
    is_reached = True
    with tempfile.TemporaryDirectory() as scratch:
        dump = os.path.join(scratch, "frames.bin")
        write_dump(dump, folder)
        voxel = ["--voxel-mm", str(arguments.voxel_mm)]
        fuse = [str(target / "release/examples/fuse_folder"), dump, *voxel,
                "--truncation-voxels", str(TRUNCATION_VOXELS), "--threads", str(arguments.threads)]
        open3d = [sys.executable, __file__, "--open3d-on", dump, *voxel]
        min_weight = 3.0 / median_depth(dump) ** 2
        fuse += ["--min-weight", f"{min_weight:.2f}"]
        meshes = [os.path.join(scratch, name) for name in ("fusion.ply", "open3d.ply")]
        for name, flags, key, least_ratio in ROWS:
            best = [float("inf")] * 2
            for _ in range(arguments.rounds):
                for side, command in enumerate((fuse, open3d)):
                    mesh = ["--mesh", meshes[side]] if not flags else []
                    report = last_line_of([*command, *flags, *mesh], arguments.threads)
                    best[side] = min(best[side], report[key] / count)
            ratio = best[1] / best[0]
            is_reached &= ratio >= least_ratio
            needed = f"(needed {least_ratio:g})" if least_ratio else ""
            print(f"  {name:24} fusion {best[0]:8.2f}   open3d {best[1]:8.2f}   ratio {ratio:6.2f} "
                  f"{needed}", flush=True)
        score, shares = f_score(meshes, F_SCORE_DISTANCE)
    is_reached &= score >= LEAST_F_SCORE
    print(f"  F-score of the meshes at {F_SCORE_DISTANCE * 1000:g} mm: {score:.4f}, shares {shares[0]:.4f} and "
          f"{shares[1]:.4f} (needed {LEAST_F_SCORE:g})")
    sys.exit(0 if is_reached else 1)


if __name__ == "__main__":
    main()
