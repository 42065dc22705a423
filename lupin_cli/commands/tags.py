"""`lupin tags`: AprilTags in images, without a robot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import typer

from lupin_cli.exit_codes import FAILURE, SUCCESS, USAGE_ERROR
from lupin_cli.terminal import echo

app = typer.Typer(help="Find AprilTags in images.", add_completion=False, rich_markup_mode=None, no_args_is_help=True)


@app.callback()
def tags() -> None:
    """Find AprilTags in images."""


@app.command()
def detect(
    images: list[Path] = typer.Argument(..., help="Images: PNG, JPEG or any format of OpenCV."),
    engine: str = typer.Option("auto", "--engine", help="Detect with apriltag or aruco; auto: apriltag if installed."),
    as_json: bool = typer.Option(False, "--json", help="Print only JSON on standard output."),
) -> None:
    """Find the tags of family 36h11: ids and corners.

    Corners are those of the black square of an upright print: top-left, top-right, bottom-right, bottom-left. They are in
    pixels, x to the right and y down; the center of the first pixel is 0, 0.

    Exit status: 0 all images were read, with or without tags in them; 1 one could not be read; 2 usage.
    """
    from lupin_runtime.perception.tags import EngineMissing, make_engine

    try:
        tag_engine = make_engine(engine)
    except (ValueError, EngineMissing) as error:
        echo(str(error), err=True)
        raise typer.Exit(USAGE_ERROR) from error
    results = [_detect_in_file(path, tag_engine) for path in images]
    if as_json:
        print(json.dumps(results))
    for result in results:
        if "error" in result:
            echo(f"{result['image']}: {result['error']}", err=True)
        elif not as_json:
            _show(result)
    raise typer.Exit(FAILURE if any("error" in result for result in results) else SUCCESS)


def _detect_in_file(path: Path, engine: Any) -> dict[str, Any]:
    import cv2
    import numpy as np

    from lupin_runtime.perception.tags import detect as detect_tags

    result: dict[str, Any] = {"image": str(path), "width": 0, "height": 0, "tags": []}
    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        return {**result, "error": f"cannot be read: {error.strerror or error}"}
    gray = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
    if gray is None:
        return {**result, "error": f"is not an image that OpenCV can read ({data.size} bytes)"}
    result["height"], result["width"] = gray.shape[:2]
    for found in detect_tags(np.asarray(gray, np.uint8), engine):
        corners = [[round(float(x), 3), round(float(y), 3)] for x, y in found.corners]
        result["tags"].append({"id": found.id, "corners": corners, "hamming": found.hamming, "fit": round(found.fit, 4)})
    return result


def _show(result: dict[str, Any]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    found = result["tags"]
    count = f"{len(found)} tag{'' if len(found) == 1 else 's'}"
    title = f"{result['image']}: {count}, {result['width']} x {result['height']} pixels"
    console = Console()
    console.print(title, highlight=False, soft_wrap=True)
    if not found:
        return
    table = Table(box=box.SIMPLE, pad_edge=False)
    table.add_column("id", justify="right")
    for name in ("top-left", "top-right", "bottom-right", "bottom-left"):
        table.add_column(name, justify="right")
    for tag in found:
        table.add_row(str(tag["id"]), *(f"{x:.2f}, {y:.2f}" for x, y in tag["corners"]))
    console.print(table)
