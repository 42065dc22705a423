"""The server certificate: its names, and that no wrong clock makes it useless."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.console.certificate import certificate_authority, leaf
from tests.support.certificates import TODAY, HostStore, reachable, utc

DAY = datetime.timedelta(days=1)
HOME = reachable("192.168.1.20")
AUTHORITY = certificate_authority.create(HOME)


@pytest.fixture
def store(tmp_path: Path) -> HostStore:
    return HostStore(tmp_path / "certificate")


def test_certificate_names_localhost_and_all_names_and_addresses() -> None:
    here = reachable("10.42.0.2", "192.168.1.20", "fd00::2")
    made = leaf.issue(AUTHORITY, here, TODAY)
    assert made.names == ("localhost", "lab-7.local", "lab-7")
    assert tuple(map(str, made.addresses)) == ("127.0.0.1", "::1", "10.42.0.2", "192.168.1.20", "fd00::2")


def test_validity_period_is_accepted_by_browsers() -> None:
    certificate = leaf.issue(AUTHORITY, HOME, TODAY).certificate
    assert certificate.not_valid_after_utc - certificate.not_valid_before_utc <= datetime.timedelta(days=397)
    assert certificate.not_valid_before_utc <= TODAY - 30 * DAY
    usage = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert list(usage) == [ExtendedKeyUsageOID.SERVER_AUTH]
    assert not certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca


@pytest.mark.parametrize(("days", "renewed"), [(0, False), (300, False), (334, False), (336, True), (400, True), (4000, True)])
def test_certificate_is_renewed_before_it_expires(store: HostStore, days: int, renewed: bool) -> None:
    first = store.ensure()
    store.now = TODAY + days * DAY
    second = store.ensure()
    assert (second.leaf.sha256 != first.leaf.sha256) == renewed
    assert second.authority.sha256 == first.authority.sha256
    assert second.leaf.certificate.not_valid_after_utc > store.now + 30 * DAY


@pytest.mark.parametrize("wrong", [utc(1970), utc(2022), utc(2026, 10, 31), utc(2027, 1), utc(2035), utc(2099)])
@pytest.mark.parametrize("right", [TODAY, utc(2029), utc(2034)])
def test_certificate_issued_by_wrong_clock_serves_when_corrected(
    store: HostStore, wrong: datetime.datetime, right: datetime.datetime
) -> None:
    store.now = wrong
    first = store.ensure()
    store.now = right
    second = store.ensure()
    assert second.authority.sha256 == first.authority.sha256  # devices have installed it
    for certificate in (second.leaf.certificate, second.authority.issuing, second.authority.root):
        assert certificate.not_valid_before_utc <= right < certificate.not_valid_after_utc


@pytest.mark.parametrize("wrong", [utc(1970), utc(2022), utc(2090)])
def test_first_certificate_under_impossible_clock_is_valid_today(store: HostStore, wrong: datetime.datetime) -> None:
    store.now = wrong
    made = store.ensure().leaf.certificate
    assert made.not_valid_before_utc < leaf.EARLIEST < made.not_valid_after_utc - 300 * DAY


@pytest.mark.parametrize("wrong", [utc(1970), utc(2022), utc(2090)])
def test_certificate_is_kept_when_booted_with_impossible_clock(store: HostStore, wrong: datetime.datetime) -> None:
    first = store.ensure()
    store.now = wrong
    assert store.ensure().leaf.sha256 == first.leaf.sha256
    store.host_addresses = reachable("192.168.1.20", "10.42.0.2")  # requires another certificate, for the last time
    second = store.ensure().leaf
    assert second.sha256 != first.leaf.sha256
    assert second.certificate.not_valid_before_utc == first.leaf.certificate.not_valid_before_utc


@given(st.datetimes(datetime.datetime(1970, 1, 1), datetime.datetime(9000, 1, 1), timezones=st.just(datetime.timezone.utc)))
def test_certificate_of_any_clock_is_not_renewed_again(clock: datetime.datetime) -> None:
    made = leaf.issue(AUTHORITY, HOME, clock)
    assert leaf.reason_to_renew(made, AUTHORITY, HOME, clock) is None
    assert made.certificate.not_valid_after_utc <= AUTHORITY.issuing.not_valid_after_utc


def test_new_address_or_name_renews_and_old_ones_stay(store: HostStore) -> None:
    first = store.ensure()
    store.host_addresses = reachable("10.42.0.2", names=("lab-8.local",))
    second = store.ensure()
    assert second.renewed == "it lacks 10.42.0.2, lab-8.local"
    assert set(first.leaf.addresses) < set(second.leaf.addresses)
    store.host_addresses = reachable("192.168.1.20")
    assert store.ensure().leaf.sha256 == second.leaf.sha256


def test_number_of_names_is_bounded(store: HostStore) -> None:
    for network in range(4):
        store.host_addresses = reachable(*(f"10.{network}.0.{number}" for number in range(1, 31)))
        made = store.ensure().leaf
        assert {str(address) for address in store.host_addresses.addresses} < {str(address) for address in made.addresses}
    assert len(made.names) + len(made.addresses) == leaf.MAX_NAMES
    store.host_addresses = reachable(*(f"10.9.0.{number}" for number in range(1, 101)))
    assert store.ensure().leaf.sha256 == store.ensure().leaf.sha256


def test_certificate_of_another_authority_is_renewed() -> None:
    other = certificate_authority.create(HOME)
    made = leaf.issue(other, HOME, TODAY)
    assert leaf.reason_to_renew(made, AUTHORITY, HOME, TODAY) == "another authority issued it"
    forged = leaf.parse(replace(made, issuing=AUTHORITY.issuing).pem())
    assert forged is None
