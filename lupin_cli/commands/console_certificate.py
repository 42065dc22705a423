"""`lupin console certificate`: the authority that vouches for the console's HTTPS."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lupin_cli.exit_codes import FAILURE, NO_RESULT, SUCCESS, USAGE_ERROR
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_cli.trust_store import TrustStore
    from lupin_runtime.console.certificate import Certificates, CertificateStore
    from lupin_runtime.console.certificate.certificate_authority import CertificateAuthority


@dataclass
class Outcome:
    """What a call of `lupin console certificate` found and did."""

    action: str
    authority: CertificateAuthority | None = None
    certificates: Certificates | None = None
    changed: bool = False
    trusted: bool | None = None  # by this system; None if that cannot be known
    next_command: str = ""  # what the user must type to complete the action
    lines: list[str] = field(default_factory=list)
    status: int = SUCCESS


def certificate(
    install: Annotated[bool, typer.Option("--install", help="Make this system trust the authority; needs root.")] = False,
    uninstall: Annotated[
        bool, typer.Option("--uninstall", help="Make this system distrust the authority; needs root.")
    ] = False,
    export: Annotated[
        Path | None, typer.Option("--export", help="Copy the authority's certificate to this file, for other devices.")
    ] = None,
    new_authority: Annotated[
        bool, typer.Option("--new-authority", help="Replace the authority; every device must install the new one.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show what would change; change nothing.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON on standard output.")] = False,
) -> None:
    """Show the authority that vouches for the console's HTTPS, and how to make a device trust it; create it if there is none.

    A browser needs it for the microphone, and to open the console from another device without a warning. The authority can
    vouch for names and addresses of local networks only.

    Exit status: 0 done, or nothing to do; 1 the system's store was not changed, and the command to type is printed; 2 usage,
    or the file of --export cannot be written; 4 no certificate can be made, and the reason is printed.

    Example: lupin console certificate --install
    """
    from lupin_runtime.console.certificate import CertificateError, CertificateStore

    requested = {"install": install, "uninstall": uninstall, "export": export is not None, "new-authority": new_authority}
    actions = [name for name, given in requested.items() if given]
    if len(actions) > 1:
        _usage(f"choose one of {' and '.join(f'--{name}' for name in actions)}")
    store = CertificateStore()
    outcome = Outcome(actions[0] if actions else "show")
    try:
        _refuse_sudo(store)
        before = store.peek()
        outcome.authority = before
        if not dry_run:
            outcome.certificates = store.ensure(new_authority=new_authority)
            outcome.authority = outcome.certificates.authority
            outcome.changed = before is None or before.sha256 != outcome.authority.sha256
    except CertificateError as error:
        echo(f"lupin console certificate: {error}", err=True)
        raise typer.Exit(NO_RESULT) from error
    _act(outcome, store, before, export, dry_run)
    _show(outcome, store, dry_run, as_json)
    raise typer.Exit(outcome.status)


def _refuse_sudo(store: CertificateStore) -> None:
    """Refuse to run under sudo if root has no certificates: the user's are meant."""
    user = os.environ.get("SUDO_USER", "root")
    if os.geteuid() == 0 and user != "root" and store.peek() is None:
        _usage(f"run it as {user}, without sudo: the certificates belong to that user; the command that needs root is printed")


def _usage(problem: str) -> None:
    echo(f"lupin console certificate: {problem}", err=True)
    raise typer.Exit(USAGE_ERROR)


def _act(
    outcome: Outcome, store: CertificateStore, before: CertificateAuthority | None, export: Path | None, dry_run: bool
) -> None:
    from lupin_cli.trust_store import find_trust_store

    trust_store = find_trust_store()
    if outcome.authority is None:
        outcome.lines.append(f"there is no usable authority; without --dry-run one is created in {store.folder}")
        return
    if trust_store is not None:
        outcome.trusted = trust_store.holds(outcome.authority.id, outcome.authority.root_pem())
    if outcome.action in ("install", "uninstall"):
        _change_trust(outcome, trust_store, store, dry_run)
    elif export is not None:
        _export(outcome, export, dry_run)
    elif outcome.action == "new-authority" and before is not None:
        _replace(outcome, before, trust_store, dry_run)


def _change_trust(outcome: Outcome, trust_store: TrustStore | None, store: CertificateStore, dry_run: bool) -> None:
    from lupin_cli.trust_store import TrustStoreError

    authority, installing = outcome.authority, outcome.action == "install"
    assert authority is not None
    if trust_store is None:
        outcome.status = FAILURE
        outcome.lines.append("Lupin cannot change this system's store; for instructions type: lupin console certificate")
        return
    if outcome.trusted == installing:
        outcome.lines.append(f"nothing to do: this system {'trusts' if installing else 'does not trust'} {authority.name}")
        return
    path = trust_store.path(authority.id)
    command = trust_store.add_command(authority.id, store.root_path) if installing else trust_store.remove_command(authority.id)
    if dry_run:
        outcome.next_command = command
        outcome.lines.append(f"would {'write' if installing else 'remove'} {path} and run {trust_store.program}")
        return
    if not trust_store.is_writable():
        outcome.status, outcome.next_command = FAILURE, command
        outcome.lines.append(f"{trust_store.folder} can be changed only by root; type:\n  {command}")
        return
    try:
        if installing:
            trust_store.add(authority.id, authority.root_pem())
        else:
            trust_store.remove(authority.id)
    except TrustStoreError as error:
        outcome.status, outcome.next_command = FAILURE, command
        outcome.lines.append(f"the system's store was not changed: {error}; try again with:\n  {command}")
        return
    outcome.changed, outcome.trusted = True, installing
    outcome.lines.append(f"this system {'now trusts' if installing else 'no longer trusts'} {authority.name} ({path})")
    if installing:
        outcome.lines.append("browsers on Linux have their own stores; for instructions type: lupin console certificate")


def _export(outcome: Outcome, path: Path, dry_run: bool) -> None:
    from lupin_runtime.atomic_file import write_atomically

    assert outcome.authority is not None
    path = path.expanduser()
    if path.is_dir():
        _usage(f"--export: {path} is a folder; name a file in it, such as {path / 'lupin.crt'}")
    if dry_run:
        outcome.lines.append(f"would write {path}")
        return
    try:
        write_atomically(path, outcome.authority.root_pem())
    except OSError as error:
        _usage(f"--export: {path} cannot be written: {error.strerror or error}")
    outcome.changed = True
    outcome.lines.append(f"wrote {path}; for instructions on each system type: lupin console certificate")


def _replace(outcome: Outcome, before: CertificateAuthority, trust_store: TrustStore | None, dry_run: bool) -> None:
    """Report what is left of the replaced authority."""
    outcome.lines.append(f"would replace {before.name}" if dry_run else f"{before.name} was replaced")
    outcome.lines.append(f"remove {before.name} from each device that trusts it; a running console uses the new one by itself")
    if trust_store is not None and trust_store.holds(before.id, before.root_pem()):
        outcome.next_command = trust_store.remove_command(before.id)
        outcome.lines.append(f"remove it from this one with:\n  {outcome.next_command}")


def _show(outcome: Outcome, store: CertificateStore, dry_run: bool, as_json: bool) -> None:
    notes = _notes(outcome)
    if as_json:
        print(json.dumps({**_facts(outcome, store), "dry_run": dry_run, "notes": notes}))
        return
    for note in notes:
        echo(f"note: {note}", err=True)
    if outcome.authority is not None and outcome.action in ("show", "new-authority"):
        _describe(outcome, store)
    for line in outcome.lines:
        echo(line)
    if outcome.authority is not None and outcome.action in ("show", "new-authority"):
        _instruct(outcome.authority, store)


def _notes(outcome: Outcome) -> list[str]:
    made = outcome.certificates
    if made is None:
        return []
    notes = list(made.notes)
    if made.omitted:
        notes.append(
            f"the authority may not vouch for {', '.join(made.omitted)}, which this machine did not have when it was made; "
            "to make one that may: lupin console certificate --new-authority"
        )
    return notes


def _facts(outcome: Outcome, store: CertificateStore) -> dict[str, Any]:
    """Return the outcome as JSON-serializable data; its keys are stable. Times are ISO 8601, in UTC."""
    authority, made = outcome.authority, outcome.certificates
    return {
        "action": outcome.action,
        "changed": outcome.changed,
        "trusted_here": outcome.trusted,
        "command": outcome.next_command or None,
        "messages": outcome.lines,
        "authority": authority
        and {
            "path": str(store.root_path),
            "name": authority.name,
            "sha256": authority.sha256,
            "not_before": authority.root.not_valid_before_utc.isoformat(),
            "not_after": authority.root.not_valid_after_utc.isoformat(),
        },
        "server": made
        and {
            "sha256": made.leaf.sha256,
            "not_before": made.leaf.certificate.not_valid_before_utc.isoformat(),
            "not_after": made.leaf.certificate.not_valid_after_utc.isoformat(),
            "names": list(made.leaf.names),
            "addresses": [str(address) for address in made.leaf.addresses],
            "omitted": list(made.omitted),
            "renewed": made.renewed,
        },
    }


def _describe(outcome: Outcome, store: CertificateStore) -> None:
    authority, made = outcome.authority, outcome.certificates
    assert authority is not None
    first, last = authority.root.not_valid_before_utc, authority.root.not_valid_after_utc
    echo(authority.name)
    echo(f"  certificate  {store.root_path}")
    echo(f"  SHA-256      {authority.sha256}")
    echo(f"  valid        {first:%Y-%m-%d} to {last:%Y-%m-%d}, for local names and networks only")
    if outcome.trusted is not None:
        verdict = "trusts it" if outcome.trusted else "does not trust it; next: lupin console certificate --install"
        echo(f"  this system  {verdict}")
    if made is not None:
        named = ", ".join((*made.leaf.names, *map(str, made.leaf.addresses)))
        echo(f"  server       {named}; until {made.leaf.certificate.not_valid_after_utc:%Y-%m-%d}, then renewed")


def _instruct(authority: CertificateAuthority, store: CertificateStore) -> None:
    from lupin_cli.trust_store import instructions

    echo("To make a device trust it, take a copy there, compare its SHA-256, and do what its system needs. Write a copy with:")
    echo(f"  lupin console certificate --export {store.root_path.name}", wrap=False)
    for system, text in instructions(authority.id, store.root_path.name):
        echo(f"  {system}:\n    {text}")
