"""`lupin tags`: AprilTags in images, without a robot."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli import user_path
from lupin_cli.command_group import command_group
from lupin_cli.exit_codes import FAILURE, SUCCESS, USAGE_ERROR
from lupin_cli.terminal import echo, work_progress
from lupin_runtime.bounded_file import MAX_IMAGE_BYTES, read_bounded

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from lupin_runtime.perception.tag_pose_estimation import Intrinsics
    from lupin_runtime.perception.tags import TagDetection, TagEngine

app = command_group("Find AprilTags in images.", "lupin tags detect picture.png", no_args_is_help=True)


@app.callback()
def tags() -> None:
    """Find AprilTags in images."""


@app.command()
def detect(
    images: list[Path] = typer.Argument(..., parser=user_path.path, help="Images: PNG, JPEG or any format of OpenCV."),
    engine: str = typer.Option("auto", "--engine", help="Detect with apriltag or aruco; auto: apriltag if installed."),
    family: str = typer.Option("tag36h11", "--family", help="Find tags of this family, such as tag25h9; needs apriltag."),
    pose: bool = typer.Option(False, "--pose", help="Compute each tag's pose in the camera's frame."),
    camera: Path = typer.Option(
        None,
        "--camera",
        metavar="FILE",
        parser=user_path.path,
        help="With --pose: the camera's calibration, YAML of ROS's camera_calibration.",
    ),
    edge: float = typer.Option(0.1, "--edge", help="With --pose: the edge of a tag's black square, m.", min=0.001, max=100.0),
    annotate: Path = typer.Option(
        None,
        "--annotate",
        metavar="FOLDER",
        parser=user_path.path,
        help="Write a copy of each image with outlines and ids to this folder, as PNG.",
    ),
    as_json: bool = typer.Option(False, "--json", help="Print only JSON on standard output."),
) -> None:
    """Find tags in images: ids and corners.

    Corners are those of the black square of an upright print: top-left, top-right, bottom-right, bottom-left. They are in
    pixels, x to the right and y down; the center of the first pixel is 0, 0. A pose is in the camera's optical frame, in
    meters: x right, y down, z ahead; the tag's axes are x right, y up and z out of its face. Without --camera, it is that of an
    assumed camera, 60 degrees wide.

    Exit status: 0 all images were read, with or without tags in them; 1 one could not be read, or a copy not be written;
    2 usage error or an unusable calibration.

    Example: lupin tags detect --pose --annotate copies picture.png
    """
    from lupin_runtime.atomic_file import MalformedFile
    from lupin_runtime.perception.calibration_file import load_calibration
    from lupin_runtime.perception.tags import EngineMissing, make_engine

    try:
        tag_engine = make_engine(engine, family)
        calibration = load_calibration(camera) if camera is not None else None
    except (ValueError, EngineMissing, MalformedFile) as error:
        echo(str(error), err=True)
        raise typer.Exit(USAGE_ERROR) from error
    except OSError as error:
        echo(f"{camera}: {error.strerror or error}; expected a calibration", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    if pose and calibration is None:
        echo("without --camera, poses are those of an assumed camera, 60 degrees wide", err=True)
    if annotate is not None and (unusable := _unusable_copies(images, annotate)):
        echo(unusable, err=True)
        raise typer.Exit(USAGE_ERROR)
    request = _Request(tag_engine, pose, calibration, edge, annotate)
    results = []
    with work_progress() as show:
        for index, path in enumerate(images):
            show(f"searching {path.name}", index / len(images))
            results.append(_detect_in_file(path, request))
    if as_json:
        print(json.dumps(results))
    for result in results:
        if "error" in result:
            echo(f"{result['image']}: {result['error']}", err=True)
        elif not as_json:
            _show(result)
    raise typer.Exit(FAILURE if any("error" in result for result in results) else SUCCESS)


@dataclass(frozen=True)
class _Request:
    """What to do with each image. `calibration` is a camera and the width of its images, px; None is the assumed camera."""

    engine: TagEngine
    pose: bool
    calibration: tuple[Intrinsics, int] | None
    edge_m: float
    annotate: Path | None

    def camera(self, width_px: int) -> Intrinsics:
        """The camera for images of this width."""
        from lupin_runtime.perception.tag_pose_estimation import Intrinsics

        if self.calibration is None:
            return Intrinsics.fallback(width_px)
        intrinsics, calibrated_px = self.calibration
        return intrinsics.scaled(width_px / calibrated_px)


def _copy_of(image: Path, folder: Path) -> Path:
    return folder / f"{image.stem}.png"


def _unusable_copies(images: list[Path], folder: Path) -> str:
    """Return why the copies cannot go to the folder; empty if they can."""
    if folder.exists() and not folder.is_dir():
        return f"{folder}: is a file; --annotate takes a folder"
    copies: dict[Path, Path] = {}
    for image in images:
        copy = _copy_of(image, folder)
        other = copies.setdefault(copy, image)
        if other != image:
            return f"--annotate: {other} and {image} would both be written to {copy}; use two folders"
        if copy.exists() and image.exists() and copy.samefile(image):
            return f"--annotate: {copy} would replace the image itself; use another folder"
    return ""


def _detect_in_file(path: Path, request: _Request) -> dict[str, Any]:
    import cv2
    import numpy as np

    from lupin_runtime.image_size import IMAGE_FORMATS, MAX_IMAGE_PIXELS, image_size
    from lupin_runtime.perception.tags import detect as detect_tags
    from lupin_runtime.perception.tags import explain_nothing

    result: dict[str, Any] = {"image": str(path), "width": 0, "height": 0, "tags": []}
    try:
        content = read_bounded(path, MAX_IMAGE_BYTES)
    except OSError as error:
        return {**result, "error": f"cannot be read: {error.strerror or error}"}
    if (size := image_size(content)) is None:
        return {**result, "error": f"is no {IMAGE_FORMATS}, or a damaged one ({len(content)} bytes)"}
    width, height = size
    if width * height > MAX_IMAGE_PIXELS:
        return {**result, "error": f"has {width} x {height} pixels; at most {MAX_IMAGE_PIXELS} are searched: scale it down"}
    data = np.frombuffer(content, np.uint8)
    try:
        gray = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    except cv2.error as error:
        return {**result, "error": f"is refused by OpenCV: {error}"}
    if gray is None:
        return {**result, "error": f"is damaged: OpenCV cannot read it ({data.size} bytes)"}
    result["height"], result["width"] = gray.shape[:2]
    found = detect_tags(np.asarray(gray, np.uint8), request.engine)
    if not found and (hint := explain_nothing(np.asarray(gray, np.uint8), request.engine)):
        result["hint"] = hint
    for tag in found:
        corners = [[round(float(x), 3), round(float(y), 3)] for x, y in tag.corners]
        entry = {"id": tag.id, "corners": corners, "hamming": tag.hamming, "fit": round(tag.fit, 4)}
        if request.pose:
            entry["pose"] = _pose(tag.corners, request.camera(gray.shape[1]), request.edge_m)
        result["tags"].append(entry)
    if request.annotate is not None:
        try:
            result["annotated"] = _write_copy(path, data, found, request.annotate)
        except OSError as error:
            result["error"] = f"the copy in {request.annotate} cannot be written: {error.strerror or error}"
    return result


def _pose(corners: NDArray[np.float64], camera: Intrinsics, edge_m: float) -> dict[str, Any] | None:
    """Return position (m) and orientation (x, y, z, w) in the camera's frame, and the root mean square error of the corners."""
    from lupin_runtime.perception.tag_pose_estimation import tag_pose

    found = tag_pose(corners, camera, edge_m)
    if found is None:
        return None
    transform = found.transform
    return {
        "position": [round(value, 5) for value in transform.translation],
        "orientation": [round(value, 6) for value in transform.rotation],
        "error_px": round(found.error_px, 3),
    }


def _write_copy(image: Path, data: NDArray[np.uint8], found: list[TagDetection], folder: Path) -> str:
    """Write the annotated copy of an image, and return its path. Raises OSError."""
    import cv2
    import numpy as np

    from lupin_runtime.atomic_file import write_atomically
    from lupin_runtime.perception.tag_drawing import draw_tags

    color = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert color is not None, "the image was decoded before"
    encoded = cv2.imencode(".png", draw_tags(np.asarray(color, np.uint8), found))[1]
    folder.mkdir(parents=True, exist_ok=True)
    copy = _copy_of(image, folder)
    write_atomically(copy, encoded.tobytes())
    return str(copy)


def _show(result: dict[str, Any]) -> None:
    from rich import box
    from rich.table import Table

    from lupin_cli.safe_console import SafeConsole

    found = result["tags"]
    count = f"{len(found)} tag{'' if len(found) == 1 else 's'}"
    title = f"{result['image']}: {count}, {result['width']} x {result['height']} pixels"
    console = SafeConsole()
    console.print(title, soft_wrap=True)
    if not found:
        if "hint" in result:
            console.print(f"  {result['hint']}", soft_wrap=True)
        return
    table = Table(box=box.SIMPLE, pad_edge=False)
    table.add_column("id", justify="right")
    for name in ("top-left", "top-right", "bottom-right", "bottom-left"):
        table.add_column(name, justify="right")
    with_pose = "pose" in found[0]
    if with_pose:
        table.add_column("position, m", justify="right")
    for tag in found:
        corners = [f"{x:.2f}, {y:.2f}" for x, y in tag["corners"]]
        position = [", ".join(f"{value:.3f}" for value in tag["pose"]["position"]) if tag["pose"] else "-"] if with_pose else []
        table.add_row(str(tag["id"]), *corners, *position)
    console.print(table)
