"""Deep files against the OpenEXR library: what thinlens shows with a closed lens is what their samples are, one over the other.

    pip install numpy OpenEXR
    python flatten.py THINLENS [FILE ...]

THINLENS is the program. The library writes deep files of random samples in every way that it can: scan lines and tiles, its codecs, half and
float, surfaces and volumes that overlap, in one file and in two. FILEs are deep files of one picture, which are merged as well. The library reads
all samples; here they are sorted, volumes are split and mixed as "Interpreting OpenEXR Deep Pixels" says, in double precision, and what is
left is composited. Prints the largest difference of each case, and fails above LIMIT.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR

LIMIT = 2e-6
WIDTH, HEIGHT = 37, 23
CHANNELS = "RGBA"


def write(path, rng, kind, compression, dtype, volumes):
    """Writes a deep file of random samples."""
    counts = rng.integers(0, 7, (HEIGHT, WIDTH))
    values = {name: np.empty((HEIGHT, WIDTH), dtype=object) for name in [*CHANNELS, "Z"] + ["ZBack"] * volumes}
    for y, x in np.ndindex(HEIGHT, WIDTH):
        count = counts[y, x]
        if count == 0:
            continue
        alpha = rng.choice([0.125, 0.25, 0.5, 0.875, 1.0], count)
        depth = rng.integers(4, 40, count) / 4
        back = depth + rng.integers(0, 4, count) * (rng.random(count) < 0.7)
        for name in "RGB":
            values[name][y, x] = (rng.random(count) * alpha).astype(dtype)
        values["A"][y, x] = alpha.astype(dtype)
        values["Z"][y, x] = depth.astype(np.float32)
        if volumes:
            values["ZBack"][y, x] = back.astype(np.float32)
    header = {"type": kind, "compression": compression}
    if kind == OpenEXR.deeptile:
        header["tiles"] = OpenEXR.TileDescription()
        header["tiles"].xSize, header["tiles"].ySize = 16, 8
    OpenEXR.File(header, values).write(str(path))


def samples(paths):
    """The samples of each pixel of the files' common window: front, back, colours and alpha."""
    parts = [part for path in paths for part in OpenEXR.File(str(path), separate_channels=True).parts]
    windows = np.array([np.concatenate(part.header["dataWindow"]) for part in parts])
    left, top, right, bottom = *windows[:, :2].min(0), *windows[:, 2:].max(0)
    pixels = [[[] for _ in range(right - left + 1)] for _ in range(bottom - top + 1)]
    for part, (x0, y0, _, _) in zip(parts, windows):
        fields = [part.channels[name].pixels for name in ["Z", "ZBack" if "ZBack" in part.channels else "Z", *CHANNELS]]
        for y, x in np.ndindex(fields[0].shape):
            if fields[0][y, x] is not None:
                pixels[y + y0 - top][x + x0 - left] += np.array([field[y, x] for field in fields], float).T.tolist()
    return pixels


def mixed(parts):
    """Samples at one place as one: colours and alpha."""
    opaque = [color for color, alpha in parts if alpha >= 1]
    if opaque:
        return np.mean(opaque, axis=0), 1.0
    depths = [-np.log1p(-alpha) for _, alpha in parts]
    total = sum(depths)
    alpha = -np.expm1(-total)
    color = sum(color * (depth / own if own > 0 else 1) for (color, own), depth in zip(parts, depths))
    return color * (alpha / total if total > 0 else 1), alpha


def part_of(sample, start, end):
    """Colour and alpha of a volume between two depths."""
    color, alpha = np.array(sample[2:5]), min(max(sample[5], 0), 1)
    share = (end - start) / (sample[1] - sample[0])
    if alpha >= 1:
        return color, 1.0
    own = -np.expm1(share * np.log1p(-alpha))
    return color * (own / alpha if alpha > 0 else share), own


def flattened(pixel):
    """Colours and alpha of a pixel's samples."""
    bounds = sorted({depth for sample in pixel for depth in (sample[0], max(sample[0], sample[1]))})
    result, passing = np.zeros(4), 1.0
    for i, at in enumerate(bounds):
        surfaces = [(np.array(s[2:5]), min(s[5], 1)) for s in pixel if s[0] == at and s[1] <= s[0]]
        groups = [surfaces] if surfaces else []
        if i + 1 < len(bounds):
            inside = [s for s in pixel if s[0] <= at and s[1] >= bounds[i + 1]]
            groups += [[part_of(s, at, bounds[i + 1]) for s in inside]] if inside else []
        for group in groups:
            color, alpha = mixed(group)
            result += passing * np.append(color, alpha)
            passing *= 1 - alpha
    return result


def compare(program, paths, what):
    """The largest difference between thinlens's picture and the samples."""
    output = Path(tempfile.mkdtemp()) / "seen.exr"
    command = [program, "render", *map(str, paths), "--f-number", "inf", "--focus", "3", "--precision", "float", "-o", str(output)]
    subprocess.run(command, check=True, capture_output=True)
    seen = OpenEXR.File(str(output)).parts[0].channels["RGBA"].pixels
    expected = np.array([[flattened(pixel) for pixel in row] for row in samples(paths)])
    error = np.abs(seen - expected).max()
    print(f"{error:.1e} {what}")
    return error


def main(program, *files):
    errors = []
    rng = np.random.default_rng(20)
    kinds = {"scan lines": OpenEXR.deepscanline, "tiles": OpenEXR.deeptile}
    codecs = ["NO_COMPRESSION", "RLE_COMPRESSION", "ZIPS_COMPRESSION", "ZIP_COMPRESSION"]
    with tempfile.TemporaryDirectory() as folder:
        for number, (kind, codec, dtype, volumes) in enumerate(
            (kind, codec, dtype, volumes)
            for kind in kinds for codec in codecs for dtype in (np.float16, np.float32) for volumes in (False, True)
        ):
            what = f"{kind}, {codec}, {dtype.__name__}, {'volumes' if volumes else 'surfaces'}"
            paths = [Path(folder) / f"{name}{number}.exr" for name in ("one", "other")]
            try:
                for path in paths:
                    write(path, rng, kinds[kind], getattr(OpenEXR, codec), dtype, volumes)
            except Exception as error:
                print(f"not written by the library: {what}: {error}")
                continue
            errors += [compare(program, paths[:1], what), compare(program, paths, f"{what}, two files")]
    if files:
        errors.append(compare(program, files, "the files"))
    if max(errors) > LIMIT:
        sys.exit(f"the largest difference is {max(errors):.1e}, above {LIMIT:.1e}")


if __name__ == "__main__":
    main(*sys.argv[1:])
