"""The command line of the exporter."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable

from thinlens_stack import frames
from thinlens_stack.errors import ExportError

VARIANTS = ("llvm_ad_rgb", "scalar_rgb", "cuda_ad_rgb")
# Versions 15 and 16 abort the process while they compile some scenes.
LEAST_LLVM = 17
KINDS = ("coverage", "point", "supersampled")
EXAMPLES = """\
examples:
  python export.py scene.xml -o stack.exr
  python export.py scene.xml --spp 64 --supersample 4 -o stack.exr
  python export.py shot.####.xml --frames 1-100 -o stacks/shot.####.exr
then:
  thinlens render stack.exr -o out.exr
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="export.py",
        description="Exports a stack of depth peels from a Mitsuba 3 scene, for thinlens.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("scene", help="the scene's XML file; with --frames, #### is the frame number")
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="the stack; with --frames, shot.####.exr")
    parser.add_argument("--frames", metavar="LIST", help="frames to export, such as 1-100,120")
    parser.add_argument("--overwrite", action="store_true", help="export frames again whose file is there already")
    parser.add_argument(
        "-D",
        dest="define",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a parameter of the scene; #### in the value is the frame number",
    )
    parser.add_argument("--sensor", type=int, default=0, metavar="INDEX", help="which sensor of the scene; default: 0")
    parser.add_argument("--integrator", metavar="NAME", help="an integrator to use instead of the scene's")
    group = parser.add_argument_group("stack")
    group.add_argument("--peels", type=_whole(1, 64), default=4, metavar="N", help="surfaces of each ray; default: 4")
    group.add_argument("--kind", choices=KINDS, default="coverage", help="what the samples are; default: coverage")
    group.add_argument(
        "--supersample",
        type=_whole(1, 8),
        metavar="S",
        help="samples per pixel along each axis; default: 2, 1 with --kind point",
    )
    group.add_argument(
        "--spp",
        type=_whole(1, 1 << 20),
        metavar="N",
        help="light paths per pixel and peel; default: those of the scene",
    )
    group.add_argument(
        "--overscan",
        type=_overscan,
        default=None,
        metavar="PX",
        help="pixels around the frame; default: auto, as far as blur reaches in, at most a quarter of the width",
    )
    group.add_argument(
        "--shading",
        action="store_true",
        help="channels for reflections: Diffuse, Reflection, Normal, ReflectedDistance, Specular, Roughness",
    )
    group.add_argument("--float", action="store_true", help="colours as 32-bit floats instead of halves")
    group = parser.add_argument_group("lens")
    group.add_argument(
        "--focus",
        type=_positive,
        metavar="DISTANCE",
        help="focus distance in scene units; default: that of a thinlens sensor",
    )
    group.add_argument(
        "--f-number", type=_positive, metavar="N", help="default: from the aperture of a thinlens sensor"
    )
    group.add_argument(
        "--sensor-width", type=_positive, default=36.0, metavar="MM", help="width of the whole film; default: 36"
    )
    group.add_argument(
        "--metres-per-unit", type=_positive, default=1.0, metavar="METRES", help="length of a scene unit; default: 1"
    )
    group = parser.add_argument_group("rendering")
    group.add_argument("--variant", choices=VARIANTS, help="variant of Mitsuba; default: the first of these that works")
    group.add_argument("--threads", type=_whole(1, 1024), metavar="N", help="number of threads; default: all cores")
    group.add_argument(
        "--seed", type=_whole(0, (1 << 32) - 1), default=0, metavar="N", help="of the random numbers; default: 0"
    )
    return parser


def _whole(least: int, most: int) -> Callable[[str], int]:
    """A parser of whole numbers from `least` to `most`."""

    def whole(text: str) -> int:
        value = int(text)
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{value} is not from {least} to {most}")
        return value

    return whole


def _positive(text: str) -> float:
    value = float(text)
    if not value > 0.0:
        raise argparse.ArgumentTypeError(f"{text} is not positive")
    return value


def _overscan(text: str) -> int | None:
    return None if text == "auto" else _whole(0, 1 << 16)(text)


def main(arguments: list[str]) -> int:
    """Exports what `arguments` say; returns the exit code."""
    options = _parser().parse_args(arguments)
    try:
        _check(options)
        numbers = frames.parse(options.frames) if options.frames else [0]
    except ExportError as error:
        print(error, file=sys.stderr)
        return frames.WRONG_USAGE
    try:
        _set_variant(options)
        export = importlib.import_module("thinlens_mitsuba.export").export
    except ExportError as error:
        print(error, file=sys.stderr)
        return frames.FAILED

    def one(frame: int, target: str) -> str:
        return export(options, frame if options.frames else None, target)

    return frames.run(numbers, options.output, one, overwrite=options.overwrite)


def _check(options: argparse.Namespace) -> None:
    """Completes the options. Raises `ExportError` for those that exclude each other."""
    if options.supersample is None:
        options.supersample = 1 if options.kind == "point" else 2
    if options.kind == "point" and options.supersample > 1:
        raise ExportError(
            "point peels have one sample a pixel",
            found=f"--supersample {options.supersample}",
            help="leave it out, or use --kind coverage or --kind supersampled",
        )
    if options.kind == "coverage" and options.supersample == 1:
        raise ExportError(
            "coverage needs several samples a pixel", found="--supersample 1", help="use 2 to 8, or --kind point"
        )


def _set_variant(options: argparse.Namespace) -> None:
    """Chooses the variant of Mitsuba. Raises `ExportError` if there is none that works."""
    try:
        import mitsuba
    except ImportError as error:
        raise ExportError("Mitsuba 3 is not installed", found=str(error), help="pip install mitsuba") from error
    problems = []
    for variant in [options.variant] if options.variant else VARIANTS[:2]:
        try:
            mitsuba.set_variant(variant)
            if not variant.startswith("scalar"):
                _start_compiler(variant, options.threads)
            if problems:
                print(f"warning: {problems[0]}; {variant} is used, which is slow", file=sys.stderr)
            return
        except (ImportError, RuntimeError) as error:
            problems.append(f"{variant} does not work: {str(error).splitlines()[0]}")
    raise ExportError("no variant of Mitsuba works", found="; ".join(problems))


def _start_compiler(variant: str, threads: int | None) -> None:
    """Tries the compiler of a vectorised variant. Raises `RuntimeError` if it does not work."""
    import drjit
    import mitsuba

    drjit.eval(mitsuba.Float(0.0) + drjit.arange(mitsuba.Float, 2))
    if variant.startswith("llvm"):
        found = drjit.detail.llvm_version()
        if found[0] < LEAST_LLVM:
            raise RuntimeError(f"LLVM {found[0]} is too old, set DRJIT_LIBLLVM_PATH to LLVM {LEAST_LLVM} or later")
    if threads:
        drjit.set_thread_count(threads)
