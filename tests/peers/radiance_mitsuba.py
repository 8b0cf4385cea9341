"""Radiance of a common scene: glint's simulator against Mitsuba 3, in one run.

    python3 tests/peers/radiance_mitsuba.py [--samples 400] [--keep FOLDER]

The example `common_scene` of the crate `scene` writes meshes, materials, an environment and a camera, and what the
simulator sees of them. Mitsuba draws the same: `diffuse` plus `roughconductor` (GGX, no Fresnel, visible normals) as a
blend of both at twice their reflectance, an `envmap` turned half about z, a box filter, paths of up to 4 segments.
Compared are pixels inside an object (their eight neighbours show the same object), mean of the three channels, relative.
Exit: 0 when the median of all differs by less than 2 % and the sum of each object by less than 2 %, or a tool is absent
(said by name), 1 otherwise. The median of an object holds the noise of both.
"""

import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
BAR = 0.02


def skip(reason):
    print(f"SKIPPED radiance_mitsuba: {reason}")
    sys.exit(0)


try:
    import mitsuba as mi
    import numpy as np
except ImportError as error:
    skip(f"python package {error.name} is absent (pip install mitsuba==3.9.1 numpy)")


def material(entry):
    albedo, r0 = entry["albedo"], entry["r0"]
    if r0 == 0:
        return {"type": "twosided", "b": {"type": "diffuse", "reflectance": {"type": "rgb", "value": albedo}}}
    return {
        "type": "twosided",
        "b": {
            "type": "blendbsdf",
            "weight": 0.5,
            "matte": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [2 * a for a in albedo]}},
            "gloss": {
                "type": "roughconductor",
                "material": "none",
                "distribution": "ggx",
                "alpha": entry["alpha"],
                "specular_reflectance": {"type": "rgb", "value": [2 * r0] * 3},
            },
        },
    }


def rendered(folder, samples):
    scene = json.loads((folder / "scene.json").read_text())
    pose = np.eye(4)
    pose[:3, :3] = np.array(scene["rotation"])
    pose[:3, 3] = scene["translation"]
    # Mitsuba's camera has x to the left and y up.
    pose = pose @ np.diag([-1.0, -1.0, 1.0, 1.0])
    described = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sensor": {
            "type": "perspective",
            "fov": math.degrees(2 * math.atan(scene["width"] / 2 / scene["focal"])),
            "fov_axis": "x",
            "to_world": mi.ScalarTransform4f(pose.tolist()),
            "near_clip": 0.01,
            "film": {
                "type": "hdrfilm",
                "width": scene["width"],
                "height": scene["height"],
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
            },
            "sampler": {"type": "independent", "sample_count": samples},
        },
        "sky": {
            "type": "envmap",
            "filename": str(folder / "environment.exr"),
            "to_world": mi.ScalarTransform4f().rotate([0, 0, 1], 180),
        },
    }
    for index, entry in enumerate(scene["objects"]):
        described[f"object{index}"] = {
            "type": "obj",
            "filename": str(folder / entry["obj"]),
            "bsdf": material(entry),
        }
    return np.array(mi.render(mi.load_dict(described)))


def layers(path):
    bitmap = mi.Bitmap(str(path))
    values = np.array(bitmap)
    names = [bitmap.struct_()[i].name for i in range(values.shape[2])]
    return {name: values[..., i] for i, name in enumerate(names)}


def inside(objects):
    """Pixels whose eight neighbours show the same object."""
    same = np.zeros(objects.shape, bool)
    core = objects[1:-1, 1:-1]
    same[1:-1, 1:-1] = core > 0
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            h, w = objects.shape
            same[1:-1, 1:-1] &= objects[1 + dy : h - 1 + dy, 1 + dx : w - 1 + dx] == core
    return same


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--samples", type=int, default=400)
    parser.add_argument("--keep", type=pathlib.Path)
    options = parser.parse_args()
    # The compiled variants need a matching LLVM; this one needs nothing.
    mi.set_variant("scalar_rgb")
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or pathlib.Path(temporary)
        built = ["cargo", "run", "--release", "-q", "-p", "scene", "--example", "common_scene", "--", str(folder)]
        subprocess.run(built, cwd=ROOT, check=True)
        theirs = rendered(folder, options.samples)
        ours = layers(folder / "radiance.exr")
        if options.keep:
            mi.util.write_bitmap(str(folder / "mitsuba.exr"), theirs)
    objects = ours["O"].round().astype(int)
    radiance = np.stack([ours[f"L.{c}"] for c in "RGB"], -1).mean(-1)
    peer = theirs.mean(-1)
    same = inside(objects)
    failed = False
    for name, mask in [(f"object {i}", same & (objects == i)) for i in range(1, objects.max() + 1)] + [("all", same)]:
        ratio = radiance[mask] / np.maximum(peer[mask], 1e-4)
        median = float(np.median(np.abs(ratio - 1)))
        bias = float(radiance[mask].sum() / peer[mask].sum() - 1)
        failed |= (median if name == "all" else abs(bias)) >= BAR
        print(f"{name:9} {mask.sum():6} pixels  median difference {100 * median:5.2f} %  of the sums {100 * bias:+5.2f} %")
    print(f"mitsuba {mi.__version__} {mi.variant()}, {options.samples} samples; bar {100 * BAR:.0f} %: {'MISSED' if failed else 'met'}")
    sys.exit(1 if failed else 0)


main()
