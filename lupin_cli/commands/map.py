"""`lupin map`: build maps from logs, optimize pose graphs and plan on maps, without a robot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from lupin_cli import user_path
from lupin_cli.command_group import command_group
from lupin_cli.commands.map_plan import plan
from lupin_cli.exit_codes import FAILURE, USAGE_ERROR
from lupin_cli.terminal import echo, work_progress
from lupin_runtime.bounded_file import NotUtf8, is_file, is_folder

if TYPE_CHECKING:
    from lupin_runtime.slam.offline import OfflineScan

_SHOWN_IDS = 10

app = command_group(
    "Build, plan on and optimize maps, without a robot.", "lupin map build recording.mcap --out map", no_args_is_help=True
)


@app.command()
def build(
    log: Path = typer.Argument(
        ..., parser=user_path.path, help="A CARMEN log (FLASER or ROBOTLASER1; .gz too), or an MCAP recording or its folder."
    ),
    out: Path = typer.Option(
        ..., "--out", parser=user_path.path, help="Write map.yaml, map.pgm, trajectory.tum and graph.g2o to this folder."
    ),
    resolution: float = typer.Option(0.05, "--resolution", help="Meters per cell.", min=0.01, max=1.0),
    max_range: float = typer.Option(
        None, "--max-range", help="Use ranges up to this, m (default: 40, or 12 for a recording).", min=0.5
    ),
    refine: bool = typer.Option(True, "--refine/--no-refine", help="Match every keyframe again after loops are closed."),
    as_json: bool = typer.Option(False, "--json", help="Print only one JSON object on standard output."),
) -> None:
    """Build a map from a log: match scans, close loops, and write each scan's pose with the log's own stamp.

    Exit status: 0 built, 1 nothing in the log can be mapped or the folder cannot be written, 2 usage error or no such log.

    Example: lupin map build recording.mcap --out map
    """
    import time

    from lupin_runtime.atomic_file import MalformedFile
    from lupin_runtime.slam.g2o import write_g2o
    from lupin_runtime.slam.map_io import save_map
    from lupin_runtime.slam.offline import NothingToMap, build_map
    from lupin_runtime.slam.tum import write_tum

    if not is_file(log) and not is_folder(log):
        echo(f"{log}: no such file or folder; expected a CARMEN log or an MCAP recording", err=True)
        raise typer.Exit(USAGE_ERROR)
    if out.exists() and not out.is_dir():
        echo(f"{out}: is a file; --out takes a folder", err=True)
        raise typer.Exit(USAGE_ERROR)
    started = time.perf_counter()
    try:
        with work_progress() as show:
            show(f"reading {log.name}", None)
            scans, problems = _read(log, max_range)
            built = build_map(scans, resolution, refine=refine, progress=show)
        for problem in problems:
            echo(f"{log}: {problem}", err=True)
        out.mkdir(parents=True, exist_ok=True)
        save_map(out / "map.yaml", built.grid)
        write_tum(out / "trajectory.tum", built.stamps, built.poses)
        write_g2o(out / "graph.g2o", built.graph)
    except (MalformedFile, NothingToMap) as error:
        echo(str(error), err=True)
        raise typer.Exit(USAGE_ERROR if isinstance(error, MalformedFile) else FAILURE) from error
    except OSError as error:
        echo(f"{error.filename or out}: {error.strerror or error}", err=True)
        raise typer.Exit(USAGE_ERROR if isinstance(error, NotUtf8) else FAILURE) from error
    result = {
        "scans": len(scans),
        "keyframes": built.keyframes,
        "closures": built.closures,
        "unmatched": built.unmatched,
        "unusable": built.unusable,
        "odometry_jumps": built.odometry_jumps,
        "left_out": built.left_out,
        "problems": len(problems),
        "map": {
            "width": built.grid.width,
            "height": built.grid.height,
            "resolution_m": built.grid.resolution_m,
            "origin": [built.grid.origin_x, built.grid.origin_y],
        },
        "seconds": round(time.perf_counter() - started, 3),
        "files": [str(out / name) for name in ("map.yaml", "map.pgm", "trajectory.tum", "graph.g2o")],
    }
    if as_json:
        print(json.dumps(result))
        return
    echo(
        f"{len(scans)} scans, {built.keyframes} keyframes, {built.closures} closures: "
        f"{built.grid.width * resolution:.1f} x {built.grid.height * resolution:.1f} m in {result['seconds']:.1f} s"
    )
    if built.unmatched or built.unusable or built.odometry_jumps:
        echo(
            f"{built.unmatched} scans did not match, {built.unusable} were unusable, "
            f"the odometry jumped {built.odometry_jumps} times"
        )
    if built.left_out:
        echo(f"{built.left_out} keyframes are not on the map: they are too far away from the others; is the odometry wrong?")
    echo(str(out / "map.yaml"))


app.command("plan")(plan)


@app.command()
def optimize(
    graph: Path = typer.Argument(
        ..., parser=user_path.path, help="A pose graph in g2o's text format: VERTEX_SE2, EDGE_SE2, or edges alone."
    ),
    out: Path = typer.Option(None, "--out", parser=user_path.path, help="Write the optimized graph to this file."),
    as_json: bool = typer.Option(False, "--json", help="Print only one JSON object on standard output."),
) -> None:
    """Find the poses that fit a pose graph's edges best.

    The poses of a file without vertices follow from its edges. Vertices that no edges join to the others are named: their place
    is arbitrary. chi2 is g2o's: the sum over edges of e' Omega e. Exit status: 0 optimized, 1 it cannot be optimized or
    written, 2 usage error or a malformed file.

    Example: lupin map optimize graph.g2o --out optimized.g2o
    """
    from dataclasses import replace

    from lupin_runtime.atomic_file import MalformedFile
    from lupin_runtime.slam.g2o import read_g2o, write_g2o
    from lupin_runtime.slam.pose_graph import GraphError, Undetermined, parts_of
    from lupin_runtime.slam.pose_graph import optimize as solve

    if not is_file(graph):
        echo(f"{graph}: no such file; expected a g2o graph", err=True)
        raise typer.Exit(USAGE_ERROR)
    try:
        read = read_g2o(graph)
        with work_progress() as show:
            show(f"optimizing {len(read.poses)} poses", None)
            try:
                solution = solve(read.poses, read.edges, read.fixed)
            except Undetermined as error:
                problem = f"the edges do not determine vertex {read.ids[error.vertex]}: its {error.free} is free; "
                raise GraphError(f"{graph}: {problem}add an edge with information on it, or FIX it") from error
        if out is not None:
            write_g2o(out, replace(read, poses=solution.poses))
    except (MalformedFile, GraphError) as error:
        echo(str(error), err=True)
        raise typer.Exit(USAGE_ERROR if isinstance(error, MalformedFile) else FAILURE) from error
    except OSError as error:
        echo(f"{error.filename or graph}: {error.strerror or error}", err=True)
        raise typer.Exit(USAGE_ERROR if isinstance(error, NotUtf8) else FAILURE) from error
    main, *others = parts_of(len(read.poses), read.edges)
    apart = sorted(read.ids[index].item() for part in others for index in part)
    result = {
        "vertices": len(read.poses),
        "edges": len(read.edges),
        "poses_from": "vertices" if read.has_vertices else "edges",
        "disconnected": apart,
        "chi2_before": solution.chi2_before,
        "chi2": solution.chi2_after,
        "chi2_after": solution.chi2_after,
        "iterations": solution.iterations,
        "converged": solution.converged,
        "started_from": solution.started_from,
        "seconds": round(solution.seconds, 4),
    }
    if apart:
        shown = ", ".join(map(str, apart[:_SHOWN_IDS])) + (" ..." if len(apart) > _SHOWN_IDS else "")
        echo(
            f"{graph}: no edges join {len(apart)} of {len(read.poses)} vertices to vertex {read.ids[main[0]]}, so their place "
            f"is arbitrary: {shown}",
            err=True,
        )
    if as_json:
        print(json.dumps(result))
        return
    echo(
        f"{result['vertices']} vertices, {result['edges']} edges: chi2 {solution.chi2_before:.6g} -> {solution.chi2_after:.6g} "
        f"in {solution.iterations} iterations, {solution.seconds:.2f} s" + ("" if solution.converged else " (not converged)")
    )


def _read(log: Path, max_range: float | None) -> tuple[list[OfflineScan], list[str]]:
    """Read the scans of a log of either kind, and the problems of unusable ones."""
    from lupin_runtime.record.reader import begins_like_recording

    if is_folder(log) or begins_like_recording(log):
        from lupin_runtime.slam.mcap_scans import read_recording

        recording = read_recording(log, range_max_m=max_range or 12.0)
        return recording.scans, recording.problems[:20]
    from lupin_runtime.slam.carmen import read_carmen
    from lupin_runtime.slam.offline import USABLE_RANGE_M, scans_from_carmen

    text = read_carmen(log)
    return scans_from_carmen(text, max_range or USABLE_RANGE_M), text.problems
