"""One runner for all benchmarks: options from a function's parameters, one table, one exit status.

A benchmark is a module `bench/bench_NAME.py`. The first line of its docstring says what it measures. Its function `main` has
the decorator `@benchmark`, which gives the limits, and returns figures: numbers by name, or tables of them. A figure's name
ends in its unit. `at_most` and `at_least` name figures by the end of their dotted path, with `*` for anything; the longest name
that fits counts. A figure `met` is a promise that no number shows.

Exit status: 0 if everything promised is met, 1 if something is missed, 2 if the benchmark could not measure.
"""

from __future__ import annotations

import argparse
import inspect
import json
import sys
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

MET, MISSED, NOT_MEASURED = 0, 1, 2
Figures = Mapping[str, Any]

# Options that several benchmarks have: Annotated with the help, and with the choices if there are any.
Only = Annotated[str, "measure only what has a name that matches this regular expression"]
Patterns = Annotated[tuple[str, ...], "use only the faults whose name matches this shell pattern; may be repeated"]
Seed = Annotated[int, "seed of everything that is drawn at random"]
Count = Annotated[int, "generate this many cases"]
Rounds = Annotated[int, "repeat each measurement this many times"]
Seconds = Annotated[float, "measure each part for this long"]
Load = Annotated[int, "run this many busy processes at the same time"]
World = Annotated[str, "drive in this world of `lupin up --world`"]
Suite = Annotated[Path | None, "also measure the server of this checkout of rosbridge_suite"]
NoPeers = Annotated[bool, "measure only lupin, and do not install pyinfra and Ansible"]
Busy = Annotated[bool, "run the measured processes with real-time priority, if this machine has other work"]
LimitS = Annotated[float, "begin nothing new after this many seconds"]
Log = Annotated[Path | None, "append each result as a JSON line, and skip what the file already has"]


def note(text: str, figures: Figures | None = None) -> None:
    """Print progress on standard error; standard output is for the figures of the whole benchmark."""
    parts = [f"{name} {format_value(value)}" for name, value in to_plain(figures or {}).items()]
    print(": ".join([text, *([", ".join(parts)] if parts else [])]), file=sys.stderr, flush=True)


def append_to_log(log: Path | None, entry: Mapping[str, Any]) -> None:
    """Append a JSON line to the log, if there is one: the results of an interrupted benchmark are not lost."""
    if log is not None:
        with log.open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry) + "\n")


@dataclass(frozen=True)
class Check:
    """A figure that was compared with its limit."""

    value: float | None
    sign: str
    bound: float

    @property
    def met(self) -> bool:
        """Whether the figure is within its limit; None is not."""
        return self.value is not None and (self.value <= self.bound if self.sign == "<=" else self.value >= self.bound)

    def __str__(self) -> str:
        ratio = f" ({self.value / self.bound:.2f} of it)" if self.value is not None and self.bound else ""
        return f"{self.sign} {self.bound:g}  {'met' if self.met else 'MISSED'}{ratio}"


@dataclass(frozen=True)
class Benchmark:
    """A function that measures, with its name, what it measures, and its limits. Calling it runs it as a command."""

    function: Callable[..., Figures | None]
    name: str
    description: str
    limits: Sequence[tuple[str, str, float]]  # the name of a figure, the sign and the bound
    long: bool

    def __call__(self, arguments: Sequence[str] | None = None) -> int:
        """Measure with the options of a command line, print the figures, and return the exit status."""
        positional, options = read_options(
            self.function, arguments, f"bench.bench_{self.name}", self.description, has_json=True
        )
        as_json = options.pop("json")
        try:
            figures = self.function(*positional, **options)
        except SystemExit as refusal:
            if isinstance(refusal.code, str):
                note(refusal.code)
            return NOT_MEASURED
        except Exception:  # Python's own status would say that a limit was missed
            sys.excepthook(*sys.exc_info())
            return NOT_MEASURED
        if figures is None:
            return MET
        figures = to_plain(figures)
        checks = self.compare(figures)
        promises = [*(check.met for check in checks.values()), *(value for path, value in leaves(figures) if path[-1] == "met")]
        if as_json:
            limits = {path: {"sign": check.sign, "bound": check.bound, "met": check.met} for path, check in checks.items()}
            print(json.dumps({"benchmark": self.name, "figures": figures, "limits": limits, "met": all(promises)}), flush=True)
        else:
            lines = [*format_table(figures, checks), *(f"{name:40} not measured" for name in self.unmeasured(figures))]
            print("\n".join(lines), flush=True)
        return MET if all(promises) else MISSED

    def compare(self, figures: Figures) -> dict[str, Check]:
        """Return the figures that have a limit, by their dotted paths."""
        checks = {}
        for path, value in leaves(figures):
            matching = [limit for limit in self.limits if _is_named(path, limit[0])]
            if matching:
                _, sign, bound = max(matching, key=lambda limit: len(limit[0]))
                checks[".".join(path)] = Check(value, sign, bound)
        return checks

    def unmeasured(self, figures: Figures) -> list[str]:
        """Return the names of the limits for which there is no figure."""
        return [name for name, *_ in self.limits if not any(_is_named(path, name) for path, _ in leaves(figures))]


def _is_named(path: Sequence[str], name: str) -> bool:
    return fnmatchcase(f".{'.'.join(path)}", f"*.{name}")


def benchmark(
    *, at_most: Mapping[str, float] | None = None, at_least: Mapping[str, float] | None = None, long: bool = False
) -> Callable[[Callable[..., Figures | None]], Benchmark]:
    """Make a benchmark of a function; its parameters become options. `long`: takes hours, so it runs only if it is named."""

    def decorate(function: Callable[..., Figures | None]) -> Benchmark:
        spec = sys.modules[function.__module__].__spec__  # of a module that is run, it has the name
        name = spec.name if spec is not None else function.__module__
        description = sys.modules[function.__module__].__doc__ or name
        limits = [("<=", at_most or {}), (">=", at_least or {})]
        rows = [(figure, sign, bound) for sign, bounds in limits for figure, bound in bounds.items()]
        return Benchmark(function, name.rpartition("bench_")[2], description, rows, long)

    return decorate


# -- options ------------------------------------------------------------------------------------------------------------
def read_options(
    function: Callable[..., Any], arguments: Sequence[str] | None, program: str, description: str, *, has_json: bool = False
) -> tuple[list[Any], dict[str, Any]]:
    """Read a command line for a function: its arguments by position and by name. Exits with 2 if the command line is wrong."""
    parser = argparse.ArgumentParser(
        prog=f"python -m {program}", description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    hints = get_type_hints(function, include_extras=True)
    parameters = inspect.signature(function).parameters.values()
    for parameter in parameters:
        _add_option(parser, parameter, hints[parameter.name])
    if has_json:
        parser.add_argument("--json", action="store_true", help="print one JSON line instead of a table")
    options = vars(parser.parse_args(arguments))
    positional = [word for p in parameters if p.kind is p.VAR_POSITIONAL for word in options.pop(p.name)]
    return positional, {name: tuple(value) if isinstance(value, list) else value for name, value in options.items()}


def _add_option(parser: argparse.ArgumentParser, parameter: inspect.Parameter, hint: Any) -> None:
    kind, text, *choices = get_args(hint)
    text = text.replace("%", "%%")
    if parameter.kind is parameter.VAR_POSITIONAL:
        parser.add_argument(parameter.name, nargs="*", help=text)
        return
    flag, default = f"--{parameter.name.rstrip('_').replace('_', '-')}", parameter.default
    if kind is bool:
        parser.add_argument(flag, dest=parameter.name, action="store_true", help=text)
        return
    is_repeated = get_origin(kind) is tuple
    if is_repeated or get_origin(kind) in (types.UnionType, Union):
        kind = next(each for each in get_args(kind) if each is not type(None))
    parser.add_argument(
        flag,
        dest=parameter.name,
        type=kind,
        action="append" if is_repeated else "store",
        default=list(default) if is_repeated else default,
        choices=choices[0] if choices else None,
        metavar=None if choices else kind.__name__.upper(),
        help=text + (f"; default: {default}" if default not in (None, "", ()) else ""),
    )


# -- figures ------------------------------------------------------------------------------------------------------------
def to_plain(value: Any) -> Any:
    """Return figures as JSON has them: data classes as mappings, and floats with six digits."""
    if is_dataclass(value):
        return {each.name: to_plain(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, Mapping):
        return {str(name): to_plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [to_plain(each) for each in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def leaves(figures: Figures, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the single figures and their paths."""
    for name, value in figures.items():
        if isinstance(value, Mapping):
            yield from leaves(value, (*path, name))
        else:
            yield (*path, name), value


def format_value(value: Any) -> str:
    """Return a figure as text."""
    if isinstance(value, float) and abs(value) < 1e15:
        return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    if isinstance(value, list):
        return ", ".join(map(format_value, value)) or "–"
    return {"None": "–", "True": "yes", "False": "no"}.get(str(value), str(value))


def format_table(figures: Figures, checks: Mapping[str, Check], path: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield lines: a single figure has one, with its limit; figures that are grouped by two names are rows and columns."""
    for name, value in figures.items():
        here = (*path, name)
        dotted = ".".join(here)
        if not isinstance(value, Mapping):
            yield f"{dotted:40} {format_value(value):>10}  {checks.get(dotted, '')}".rstrip()
        elif value and all(_is_row(row) for row in value.values()):
            yield from _format_rows(dotted, value, checks)
        else:
            yield from format_table(value, checks, here)


def _is_row(value: Any) -> bool:
    return isinstance(value, Mapping) and not any(isinstance(each, Mapping) for each in value.values())


def _format_rows(title: str, rows: Figures, checks: Mapping[str, Check]) -> Iterator[str]:
    columns = list(dict.fromkeys(name for row in rows.values() for name in row if name != "met"))
    table = [[title, *columns]]
    table += [[name, *(format_value(row[column]) if column in row else "" for column in columns)] for name, row in rows.items()]
    widths = [max(len(line[index]) for line in table) for index in range(len(columns) + 1)]
    verdicts = [""]
    for name, row in rows.items():
        limited = {column: checks[key] for column in columns if (key := f"{title}.{name}.{column}") in checks}
        parts = [f"{column} {check}" for column, check in limited.items()]
        verdicts.append("; ".join([*parts, *(["met" if row["met"] else "MISSED"] if "met" in row else [])]))
    for line, verdict in zip(table, verdicts):
        first, *others = line
        yield "  ".join([first.ljust(widths[0]), *map(str.rjust, others, widths[1:]), verdict]).rstrip()
