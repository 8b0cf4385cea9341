"""Nearest hits: glint's crate `raytrace` against Embree, one core each, in one run.

    python3 tests/peers/raycast_embree.py [--binary PATH] [--rounds 9] [--least-ratio 0.6] [--ply FILE]

Mesh: 300 000 triangles by formula, a bumpy room around a bumpy ball (or the triangles of a binary
little-endian PLY with vertices first, x y z first among their properties). Rays: 640 x 480 primaries in scan
order, then the mirror reflections of those that hit, about the interpolated normals, in scan order. The two
take turns `--rounds` times on one core; CPU time is compared, each side's median and best are printed, and the
ratio of the bests counts. Embree by PyPI `embreex`: time includes its own copies from and to numpy arrays, as
ours includes preparing each ray and writing triangle, t, u, v. Hits are compared: same triangle, or the same
distance within 1e-5.
Without --binary the example `raycast_bench` is built with cargo.
Exit: 0 when both ratios are reached or a tool is absent (said by name), 1 otherwise.
"""

import argparse
import json
import os
import pathlib
import statistics
import struct
import subprocess
import sys
import tempfile
import time

os.environ["OMP_NUM_THREADS"] = "1"
ROOT = pathlib.Path(__file__).resolve().parents[2]
WIDTH, HEIGHT, FOCAL = 640, 480, 525.0


def skip(reason):
    print(f"SKIPPED raycast_embree: {reason}")
    sys.exit(0)


try:
    import numpy as np
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh
except ImportError as error:
    skip(f"python package {error.name} is absent (pip install embreex numpy)")


def bumpy_sphere(columns, rows, radius, bump, center):
    """2 * columns * (rows - 1) triangles on a latitude-longitude grid."""
    lon = np.arange(columns) * (2 * np.pi / columns)
    lat = (np.arange(rows + 1) / rows - 0.5) * (np.pi * 0.9999)
    lon, lat = np.meshgrid(lon, lat)
    wave = np.sin(9 * lon) * np.cos(11 * lat) + 0.5 * np.sin(31 * lon + 3) * np.sin(23 * lat)
    r = radius * (1 + bump * wave)
    points = np.stack([r * np.cos(lat) * np.sin(lon), -r * np.sin(lat), r * np.cos(lat) * np.cos(lon)], -1)
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = a + columns, b + columns
    faces = np.concatenate([np.stack([a, b, d], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])
    return points.reshape(-1, 3) + np.asarray(center), faces


def scene_by_formula():
    room, room_faces = bumpy_sphere(500, 200, 2.5, 0.04, (0.0, 0.0, 0.0))
    ball, ball_faces = bumpy_sphere(500, 100, 0.5, 0.02, (0.1, 0.1, 0.9))
    points = np.concatenate([room, ball]).astype(np.float32)
    faces = np.concatenate([room_faces, ball_faces + len(room)]).astype(np.uint32)
    return points, faces


def read_ply(path):
    data = pathlib.Path(path).read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    types = {"float": "<f4", "double": "<f8", "uchar": "u1", "ushort": "<u2", "int": "<i4", "uint": "<u4"}
    elements, fields = [], []
    for line in data[:end].decode("ascii").split("\n"):
        words = line.split()
        if words[:1] == ["element"]:
            elements.append((words[1], int(words[2])))
        elif words[:1] == ["property"] and words[1] != "list" and len(elements) == 1:
            fields.append((words[2], types[words[1]]))
    vertices = np.frombuffer(data, np.dtype(fields), elements[0][1], end)
    start = end + vertices.nbytes
    faces = np.frombuffer(data, np.dtype([("n", "u1"), ("v", "<u4", 3)]), elements[1][1], start)["v"]
    points = np.stack([vertices[k] for k in "xyz"], -1)
    return np.ascontiguousarray(points, np.float32), np.ascontiguousarray(faces, np.uint32)


def primary_rays(eye, target):
    """Rays of a pinhole camera at `eye` that looks at `target`, y down."""
    forward = np.asarray(target, float) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross((0.0, 1.0, 1e-3), forward)
    right /= np.linalg.norm(right)
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    directions = np.stack([(x - 319.5) / FOCAL, (y - 239.5) / FOCAL, np.ones_like(x, float)], -1).reshape(-1, 3)
    directions = directions @ np.stack([right, np.cross(forward, right), forward])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.broadcast_to(np.float32(eye), directions.shape).copy(), directions.astype(np.float32)


def vertex_normals(points, faces):
    p = points.astype(np.float64)
    n = np.cross(p[faces[:, 1]] - p[faces[:, 0]], p[faces[:, 2]] - p[faces[:, 0]])
    normals = np.zeros_like(p)
    for k in range(3):
        np.add.at(normals, faces[:, k], n)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


def mirrored_rays(embree, points, faces, origins, directions):
    out = embree.run(origins, directions, output=True)
    hit = out["primID"] >= 0
    u, v, face = out["u"][hit][:, None], out["v"][hit][:, None], faces[out["primID"][hit]]
    p, n = points.astype(np.float64), vertex_normals(points, faces)
    position = p[face[:, 0]] * (1 - u - v) + p[face[:, 1]] * u + p[face[:, 2]] * v
    normal = n[face[:, 0]] * (1 - u - v) + n[face[:, 1]] * u + n[face[:, 2]] * v
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    d = directions[hit].astype(np.float64)
    normal = np.where((normal * d).sum(1, keepdims=True) > 0, -normal, normal)
    mirrored = d - 2 * (d * normal).sum(1, keepdims=True) * normal
    return (position + normal * 4e-3).astype(np.float32), mirrored.astype(np.float32)


class Ours:
    """The example, fed requests line by line."""

    def __init__(self, binary, folder, name, points, faces, rays):
        self.dump = pathlib.Path(folder) / f"{name}.bin"
        self.hits_path = pathlib.Path(folder) / f"{name}.hits"
        with open(self.dump, "wb") as out:
            out.write(struct.pack("<III", len(points), len(faces), len(rays[0])))
            out.write(points.tobytes() + faces.tobytes() + np.concatenate(rays, 1).astype("<f4").tobytes())
        pipe = subprocess.PIPE
        self.process = subprocess.Popen([str(binary), str(self.dump)], stdin=pipe, stdout=pipe, text=True)
        self.build = json.loads(self.process.stdout.readline())

    def ask(self, request):
        self.process.stdin.write(request + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())["core_s"]

    def hits(self):
        self.ask(f"hits {self.hits_path}")
        return np.fromfile(self.hits_path, np.dtype([("triangle", "<u4"), ("t", "<f4")]))

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def timed(call):
    before = time.process_time()
    call()
    return time.process_time() - before


def compare(name, ours, embree, rays, rounds):
    origins, directions = rays
    ours.ask("closest"), embree.run(origins, directions)
    seconds = {"ours": [], "embree": [], "ours any": [], "embree any": []}
    for _ in range(rounds):
        seconds["ours"].append(ours.ask("closest"))
        seconds["embree"].append(timed(lambda: embree.run(origins, directions)))
        seconds["ours any"].append(ours.ask("any"))
        seconds["embree any"].append(timed(lambda: embree.run(origins, directions, query="OCCLUDED")))
    rate = {k: (len(origins) / min(v) / 1e6, len(origins) / statistics.median(v) / 1e6) for k, v in seconds.items()}
    found, theirs = ours.hits(), embree.run(origins, directions, output=True)
    triangle, their_triangle = found["triangle"].astype(np.int64), theirs["primID"].astype(np.int64)
    triangle[triangle == 2**32 - 1] = -1
    same_triangle = triangle == np.maximum(their_triangle, -1)
    both = (triangle >= 0) & (their_triangle >= 0)
    near = both & (np.abs(found["t"] - theirs["tfar"]) <= 1e-5 * np.maximum(theirs["tfar"], 1e-2))
    result = {
        "rays": name,
        "count": len(origins),
        "hit_fraction": float(both.mean()),
        "mray_per_core_s best/median": {k: [round(x, 3) for x in v] for k, v in rate.items()},
        "ratio": round(rate["ours"][0] / rate["embree"][0], 3),
        "ratio_of_medians": round(rate["ours"][1] / rate["embree"][1], 3),
        "ratio_any": round(rate["ours any"][0] / rate["embree any"][0], 3),
        "same_triangle_fraction": float(same_triangle.mean()),
        "unlike_count": int((~same_triangle & ~near).sum()),
    }
    print(json.dumps(result), flush=True)
    return result["ratio"]


def built_binary():
    command = ["cargo", "build", "--release", "-p", "raytrace", "--example", "raycast_bench", "--message-format=json"]
    output = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    messages = [json.loads(line) for line in output.splitlines() if line.startswith("{")]
    return next(m["executable"] for m in messages if (m.get("target") or {}).get("name") == "raycast_bench")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--least-ratio", type=float, default=0.6)
    parser.add_argument("--ply")
    parser.add_argument("--eye", nargs=3, type=float, default=(0.0, 0.0, 0.0), help="metres, axes of the mesh")
    parser.add_argument("--target", nargs=3, type=float, default=(0.0, 0.0, 1.0), help="what the camera looks at")
    arguments = parser.parse_args()
    binary = arguments.binary or built_binary()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    points, faces = read_ply(arguments.ply) if arguments.ply else scene_by_formula()
    embree = rtcore_scene.EmbreeScene()
    before = time.process_time()
    TriangleMesh(embree, points, faces.astype(np.int32))
    primary = primary_rays(arguments.eye, arguments.target)
    embree.run(*(a[:1] for a in primary))
    print(json.dumps({"triangles": len(faces), "embree_build_core_s": time.process_time() - before}))
    ratios = []
    with tempfile.TemporaryDirectory() as folder:
        mirrored = mirrored_rays(embree, points, faces, *primary)
        for name, rays in [("primary", primary), ("mirrored", mirrored)]:
            ours = Ours(binary, folder, name, points, faces, rays)
            print(json.dumps(ours.build))
            ratios.append(compare(name, ours, embree, rays, arguments.rounds))
            ours.close()
    sys.exit(0 if min(ratios) >= arguments.least_ratio else 1)


if __name__ == "__main__":
    main()
