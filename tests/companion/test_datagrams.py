"""UDP endpoints: a server answers everyone that it has heard, a client its one destination by name or number."""

from __future__ import annotations

import socket
import time
from contextlib import closing

import pytest
from patience import HANG_S

from companion.mavlink.link import Arrivals, open_link
from companion.mavlink.outgoing import heartbeat


def bound() -> socket.socket:
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.bind(("127.0.0.1", 0))
    out.settimeout(HANG_S)
    return out


def free_port() -> int:
    with bound() as probe:
        return probe.getsockname()[1]


def drained(link) -> int:
    """Frames that arrive together, sooner or later."""
    until, count = time.monotonic() + HANG_S, 0
    while not count and time.monotonic() < until:
        count += len(list(link.drain()))
        time.sleep(0.01)
    return count


def test_a_server_answers_everyone_that_it_has_heard_and_one_that_cannot_be_reached_stops_no_other():
    port = free_port()
    with (
        closing(open_link(f"udpin:127.0.0.1:{port}", Arrivals())) as link,
        bound() as first,
        bound() as second,
    ):
        link.send(*heartbeat())  # nobody is known yet
        frame = link.frame(*heartbeat())
        for peer in (first, second):
            peer.sendto(frame, ("127.0.0.1", port))
            assert drained(link) == 1
        assert set(link.peers) == {first.getsockname(), second.getsockname()}
        link._datagrams.peers = (("127.0.0.1", 0), *link.peers)  # port 0: the system refuses it
        link.send(*heartbeat())
        assert first.recv(300)[:1] == second.recv(300)[:1] == b"\xfd"


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_a_client_speaks_first_and_hears_the_answer(host):
    with bound() as server:
        endpoint = f"udpout:{host}:{server.getsockname()[1]}"
        with closing(open_link(endpoint, Arrivals())) as link:
            link.send(*heartbeat())
            data, address = server.recvfrom(300)
            assert data[:1] == b"\xfd"
            assert link.peers == (server.getsockname(),)
            server.sendto(data, address)
            assert drained(link) == 1


def test_a_program_that_speaks_from_ever_new_ports_does_not_make_every_answer_dearer():
    port = free_port()
    with closing(open_link(f"udpin:127.0.0.1:{port}", Arrivals())) as link, bound() as vehicle:
        frame = link.frame(*heartbeat())
        for k in range(60):
            if k % 10 == 0:
                vehicle.sendto(frame, ("127.0.0.1", port))
            with bound() as stranger:
                stranger.sendto(frame, ("127.0.0.1", port))
            drained(link)
        assert vehicle.getsockname() in link.peers
        assert len(link.peers) <= 8


def test_a_peer_that_has_long_been_silent_gives_its_place(monkeypatch):
    port, now = free_port(), [100.0]
    monkeypatch.setattr("companion.mavlink.datagrams.monotonic", lambda: now[0])
    with closing(open_link(f"udpin:127.0.0.1:{port}", Arrivals())) as link:
        frame = link.frame(*heartbeat())
        for _ in range(12):
            with bound() as restarted:
                restarted.sendto(frame, ("127.0.0.1", port))
                drained(link)
                assert restarted.getsockname() in link.peers
            now[0] += 60.0


def test_a_flood_does_not_keep_the_loop_from_its_other_work():
    port = free_port()
    with closing(open_link(f"udpin:127.0.0.1:{port}", Arrivals())) as link, bound() as neighbour:
        frame = link.frame(*heartbeat())
        neighbour.sendto(frame, ("127.0.0.1", port))
        for taken, _ in enumerate(link.drain()):  # as many come as are taken
            neighbour.sendto(frame, ("127.0.0.1", port))
            if taken > 5000:
                pytest.fail("never comes to an end")
        neighbour.sendto(frame, ("127.0.0.1", port))
        assert drained(link), "the next turn goes on with what has waited"
