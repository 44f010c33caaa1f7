"""The mouse pulls the simulated tool in the page of `tilthex view --sim`, in a real browser."""

import contextlib
import socket

import chromium
import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed: the page is not tested")

import viser.transforms as vtf
from tilthex.view.hand import LARGEST, PER_METRE, WRENCH, Hand

pytestmark = pytest.mark.real_time


def test_the_mouse_pulls_the_ball(served, tmp_path):
    chromium.browser()
    address = f"http://127.0.0.1:{served.get_port()}/"
    served.initial_camera.position, served.initial_camera.look_at = (2.0, 0.0, 1.0), (0.0, 0.0, 1.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flight:
        flight.bind(("127.0.0.1", 0))
        flight.settimeout(60.0)
        hand = Hand(served, flight.getsockname()[1])
        hand.ball.position, hand.ball.scale = (0.0, 0.1, 1.05), 4.0

        def felt(done):
            while not done(wrench := np.array(WRENCH.unpack(flight.recv(100)))):
                pass
            return wrench

        with contextlib.closing(hand), chromium.opened(address, tmp_path / "profile", (800, 600)) as tab:
            tab.wait("!!document.querySelector('canvas')")
            while not (clients := served.get_clients()):
                tab.text()
            (client,) = clients.values()
            tab.wait("document.body.innerText.includes('hand')")
            x, y, metre = screen(tab, client.camera, hand.ball.position)
            expected = PER_METRE * 60 / metre
            # The first may come before the ball is drawn.
            for _ in range(5):
                with tab.dragged(x, y, 60, 0):
                    if hand.pulls:
                        break
            # The camera looks along -x: right is +y.
            with tab.dragged(x, y, 60, 0):
                pull = felt(lambda wrench: wrench[1] > 0.9 * expected)
                assert pull[1] == pytest.approx(expected, rel=0.1)
                assert np.allclose(pull[[0, 2, 3, 4, 5]], 0.0, atol=0.1 * pull[1])
                assert np.linalg.norm(pull) <= LARGEST + 1e-9
            assert np.array_equal(felt(lambda wrench: not wrench.any()), np.zeros(6))


def screen(tab, camera, position):
    """Where a point of the world is in the tab, and how long a metre there is, pixels."""
    left, top, width, height = tab.run(
        "(r => [r.left, r.top, r.width, r.height])(document.querySelector('canvas').getBoundingClientRect())"
    )
    x, y, z = vtf.SO3(camera.wxyz).as_matrix().T @ (np.asarray(position) - camera.position)
    scale = 0.5 * height / np.tan(0.5 * camera.fov)
    return left + 0.5 * width + scale * x / z, top + 0.5 * height + scale * y / z, scale / z
