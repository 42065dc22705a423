"""The record of active faults stays as it was if injecting or undoing a fault fails."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from lupin_sim.host.computer import Computer
from lupin_sim.host.fault_injector import Fault, FaultError, FaultInjector, FaultKey, Settings
from lupin_sim.host.network import Network

COMPUTER = cast(Computer, SimpleNamespace(identity=SimpleNamespace(index=0)))
FIRST, SECOND = {"link": "eth0", "delay_ms": 40.0}, {"link": "eth0", "delay_ms": 60.0}
KEY = FaultKey(0, "slow", "eth0")


class FaultyNetwork:
    """Stands in for the network: records the settings of links, and fails on demand."""

    def __init__(self) -> None:
        self.impaired: list[tuple[str, Any]] = []
        self.fails = False

    def impair(self, _: object, link: str, settings: Any) -> None:
        if self.fails:
            raise FaultError("the link emulator exited")
        self.impaired.append((link, settings))


def update_link(injector: FaultInjector, computer: Computer, settings: Settings) -> None:
    injector.update_link(computer, settings["link"])


TABLE = {
    "slow": Fault(
        "the link is slow",
        inject=update_link,
        undo=update_link,
        settings=FIRST,
        external=True,
        link_settings=lambda settings: {"delay_ms": settings["delay_ms"]},
    )
}


@pytest.fixture
def network() -> FaultyNetwork:
    return FaultyNetwork()


@pytest.fixture
def injector(network: FaultyNetwork) -> FaultInjector:
    return FaultInjector(TABLE, cast(Network, network), [COMPUTER], Path("/nonexistent"), Path("/nonexistent"))


def test_failed_first_injection_leaves_no_record(injector: FaultInjector, network: FaultyNetwork) -> None:
    network.fails = True
    with pytest.raises(FaultError, match="exited"):
        injector.inject(COMPUTER, "slow", FIRST)
    assert injector.active_faults(COMPUTER) == []


def test_failed_repeated_injection_keeps_the_first_record(injector: FaultInjector, network: FaultyNetwork) -> None:
    injector.inject(COMPUTER, "slow", FIRST)
    network.fails = True
    with pytest.raises(FaultError, match="exited"):
        injector.inject(COMPUTER, "slow", SECOND)
    assert injector._active == {KEY: FIRST}


@pytest.mark.parametrize("settings", [{}, {"link": "eth0"}])
def test_failed_undo_keeps_the_record_and_can_be_repeated(
    injector: FaultInjector, network: FaultyNetwork, settings: dict[str, Any]
) -> None:
    injector.inject(COMPUTER, "slow", FIRST)
    network.fails = True
    with pytest.raises(FaultError, match="exited"):
        injector.undo(COMPUTER, "slow", settings)
    assert injector._active == {KEY: FIRST}
    network.fails = False
    injector.undo(COMPUTER, "slow", settings)
    assert (injector.active_faults(COMPUTER), network.impaired) == ([], [("eth0", {"delay_ms": 40.0}), ("eth0", None)])


def test_failed_reset_keeps_the_record_of_an_external_fault(injector: FaultInjector, network: FaultyNetwork) -> None:
    injector.inject(COMPUTER, "slow", FIRST)
    network.fails = True
    with pytest.raises(FaultError, match="exited"):
        injector.prepare_reset(COMPUTER)
    assert injector._active == {KEY: FIRST}
    network.fails = False
    injector.prepare_reset(COMPUTER)
    assert injector.active_faults(COMPUTER) == []


def test_fault_on_both_links_is_undone_on_one_or_on_both(injector: FaultInjector) -> None:
    wireless = {**FIRST, "link": "wlan0"}
    injector.inject(COMPUTER, "slow", FIRST)
    injector.inject(COMPUTER, "slow", wireless)
    injector.undo(COMPUTER, "slow", {"link": "eth0"})
    assert injector._active == {FaultKey(0, "slow", "wlan0"): wireless}
    injector.inject(COMPUTER, "slow", FIRST)
    injector.undo(COMPUTER, "slow", {})
    assert injector.active_faults(COMPUTER) == []
