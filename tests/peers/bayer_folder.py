"""A folder that `glint import` takes as the raw streams of a structured-light camera: depth and Bayer mosaic.

    python3 tests/peers/bayer_folder.py DEPTH_FOLDER COLOUR_PNG_FOLDER OUT [COUNT]
    glint import OUT -o bayer.glint && glintd info bayer.glint

DEPTH_FOLDER is a folder of 7-Scenes (frame-NNNNNN.depth.png, .pose.txt: ../shared/data/redkitchen), of which
the first COUNT frames (default 300) are taken in order, byte for byte. COLOUR_PNG_FOLDER holds colour frames
that never were JPEG, 640x480 RGB PNG (../shared/data/colour-png). They are cycled through forward and backward
and made mosaics again: even rows G R G R ..., odd rows B G B G ... . The mosaics are proxies, since the
camera has demosaicked and denoised; what is measured on them says something of that sensor family only.

OUT must not exist. It gets frame-NNNNNN.color.png (8 bits grey), .depth.png, .pose.txt and rig.toml with
`color.format = "bayer-grbg"` at 30 frames a second: colour and depth of a frame have one time, frame / 30 s.
Depth and colour are of different rooms: good for sizes and rates, not for training.
Exit: 0 when the folder is made or a package is absent (said by name), 1 otherwise.
"""

import argparse
import pathlib
import shutil
import sys

try:
    import numpy as np
    from PIL import Image
except ImportError as error:
    print(f"SKIPPED bayer_folder: python package {error.name} is absent (pip install numpy pillow)")
    sys.exit(0)

RIG = """\
# Depth of one sensor, colour of another of its family, re-mosaicked: see tests/peers/bayer_folder.py
frame_rate = 30.0
sync = "none"
poses = "depth"

[color]
width = {width}
height = {height}
format = "bayer-grbg"
fx = 525.0
fy = 525.0
cx = 319.5
cy = 239.5

[color.response]
type = "gamma"
gamma = 2.2

[color.exposure]
fixed = false
relative = 1.0

[depth]
width = 640
height = 480
format = "png16"
scale = 0.001
range = [0.4, 8.0]
fx = 585.0
fy = 585.0
cx = 320.0
cy = 240.0

[depth.color_from_depth]
rotation = [0.0, 0.0, 0.0, 1.0]
translation = [-0.025, 0.0, 0.0]
"""


def mosaic(rgb):
    """The samples that a GRBG sensor would have kept of an RGB image."""
    kept = rgb[:, :, 1].copy()
    kept[0::2, 1::2] = rgb[0::2, 1::2, 0]
    kept[1::2, 0::2] = rgb[1::2, 0::2, 2]
    return kept


def there_and_back(count, length):
    """0, 1, ... length - 1, length - 2, ... 1, 0, 1, ...: no frame follows itself."""
    period = max(2 * (length - 1), 1)
    return [min(step % period, period - step % period) for step in range(count)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("depth_folder", type=pathlib.Path)
    parser.add_argument("colour_png_folder", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("count", type=int, nargs="?", default=300)
    arguments = parser.parse_args()
    depth = sorted(arguments.depth_folder.glob("frame-*.depth.png"))[: arguments.count]
    names = sorted(arguments.colour_png_folder.glob("*.color.png"))
    if len(depth) < arguments.count or not names:
        sys.exit(f"{len(depth)} depth and {len(names)} colour images found, {arguments.count} and 1 needed")
    mosaics = [mosaic(np.asarray(Image.open(name).convert("RGB"))) for name in names]
    if len({image.shape for image in mosaics}) != 1:
        sys.exit(f"{arguments.colour_png_folder}: the colour images are of several sizes")
    height, width = mosaics[0].shape
    arguments.out.mkdir(parents=True)
    order = there_and_back(len(depth), len(mosaics))
    for number, (source, chosen) in enumerate(zip(depth, order)):
        target = arguments.out / f"frame-{number:06d}"
        shutil.copyfile(source, f"{target}.depth.png")
        pose = source.name.replace(".depth.png", ".pose.txt")
        shutil.copyfile(source.with_name(pose), f"{target}.pose.txt")
        # What comes back is what counts, so little work goes into the PNG.
        Image.fromarray(mosaics[chosen]).save(f"{target}.color.png", compress_level=1)
    (arguments.out / "rig.toml").write_text(RIG.format(width=width, height=height))
    print(f"{len(depth)} frames with {len(mosaics)} mosaics of {width}x{height} in {arguments.out}")


if __name__ == "__main__":
    main()
