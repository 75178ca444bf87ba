"""The live page in a real browser: a drag moves the arm, and the server ends with its viewers."""

from __future__ import annotations

import io
import shutil
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from octoplan.model.extensions.obstacles import Sphere
from octoplan.planner.frontends.live.drawing import DARK, LIGHT, Colour
from octoplan.planner.frontends.live.page import Page
from tests.frontends.test_live import ARM, free_port, session
from tests.oracles import Array


def on_screen(client: Any, place: Array, size: tuple[int, int]) -> Array:
    """Return the place of a point in a browser of a given size [pixels]."""
    camera = client.camera
    forward = np.array(camera.look_at) - camera.position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    seen = place - np.array(camera.position)
    half = size[1] / 2 / np.tan(camera.fov / 2) / (seen @ forward)
    up = np.cross(right, forward)
    return np.array(size) / 2 + half * np.array([seen @ right, -(seen @ up)])


def turns_to(viewer: Any, top: Colour) -> bool:
    """Return whether the top of the background shows a colour within 60 screenshots."""
    for _ in range(60):
        seen = Image.open(io.BytesIO(viewer.screenshot())).convert("RGB")
        if np.abs(np.subtract(seen.getpixel((2, 2)), top)).max() <= 8:
            return True
        viewer.wait_for_timeout(500)
    return False


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_in_a_browser_a_drag_moves_the_arm(tmp_path: Path) -> None:
    pytest.importorskip("viser")
    driver = pytest.importorskip("playwright.sync_api")
    chromium = shutil.which("chromium") or pytest.skip("no Chromium")
    far = Sphere((0.1, 0.3, 0.1), 0.02)
    hand, port, size = session(obstacles=[far]), free_port(), (1200, 800)
    page = Page(hand, "localhost", port)
    options = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    said: list[str] = []
    with driver.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=options)
        viewers = [browser.new_page(viewport={"width": size[0], "height": size[1]}) for _ in "12"]
        for viewer in viewers:
            viewer.on("console", lambda m: said.append(m.text) if m.type == "error" else None)
            viewer.on("pageerror", lambda error: said.append(str(error)))
            viewer.goto(f"http://localhost:{port}")
            viewer.get_by_text("Reached: every target met").wait_for(timeout=300_000)
        viewer = viewers[0]
        before = hand.last
        client = page._server.get_clients()[0]
        arrow = page._control.position + np.array([0.0, 0.0, 0.6 * 0.25 * ARM.length])
        start = on_screen(client, arrow, size)
        end = on_screen(client, arrow + np.array([0.0, 0.0, 0.02]), size)
        viewer.mouse.move(*start)
        viewer.wait_for_timeout(500)
        viewer.mouse.down()
        viewer.mouse.move(*end, steps=12)
        viewer.mouse.up()
        viewer.wait_for_timeout(1000)
        viewers[1].get_by_text("Reached: every target met").wait_for(timeout=300_000)
        viewer.get_by_text("Reached: every target met").wait_for(timeout=300_000)
        viewer.screenshot(path=tmp_path / "live.png")
        after = hand.last
        assert before is not None
        assert after is not None
        moved = after.shape.tip - before.shape.tip
        assert moved == pytest.approx([0.0, 0.0, 0.02], abs=4e-3)
        viewer.get_by_label("Compliance ellipsoid").evaluate("box => box.click()")
        viewer.get_by_text("/ellipsoid").wait_for(state="attached", timeout=300_000)
        viewer.get_by_label("0: Sphere").evaluate("box => box.click()")
        viewer.wait_for_timeout(1000)
        assert hand.present == [False]
        with viewer.expect_download(timeout=300_000) as saved:
            viewer.get_by_text("Save the plan").click()
        assert '"certified":true' in Path(saved.value.path()).read_text().replace(" ", "")
        for dark in (True, False):
            viewer.get_by_role("checkbox", name="Dark", exact=True).evaluate("box => box.click()")
            assert turns_to(viewer, (DARK if dark else LIGHT).top)
        browser.close()
    page.wait(grace=0.3)
    page.end()
    assert not said


@pytest.mark.slow
def test_the_server_ends_with_its_last_browser_though_a_plan_is_searched_for(
    tmp_path: Path,
) -> None:
    pytest.importorskip("viser")
    driver = pytest.importorskip("playwright.sync_api")
    chromium = shutil.which("chromium") or pytest.skip("no Chromium")
    scene, port = tmp_path / "scene.toml", free_port()
    scene.write_text(
        "accuracy = 1e-9\narm = { preset = 'table-4' }\n"
        "effects = { silicone = true, weight = { g = [0, 0, -9.81] } }\n"
        "[target]\ntype = 'tip-position'\nposition_mm = [250, 0, -90]\n[limits]\ntension_max = 9\n"
    )
    asked = [sys.executable, "-m", "octoplan", "live", str(scene), "--port", str(port)]
    server = subprocess.Popen(asked, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        with driver.sync_playwright() as play:
            options = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
            browser = play.chromium.launch(executable_path=chromium, args=options)
            viewers = [browser.new_page() for _ in "12"]
            for viewer in viewers:
                viewer.goto(address(port))
                viewer.get_by_text("Target x, y, z").wait_for(timeout=300_000)
            viewers[0].close()
            viewers[1].wait_for_timeout(4000)
            assert server.poll() is None, "a viewer is there still"
            viewers[1].close()
            browser.close()
        out, said = server.communicate(timeout=60)
    finally:
        server.kill()
    assert server.returncode == 0
    assert out == "The last browser was closed.\n"
    assert "Traceback" not in said
    with socket.create_server(("localhost", port)):
        pass  # the port is free again


def address(port: int) -> str:
    """Return the address of a page after the server started."""
    for _ in range(600):
        with suppress(OSError), socket.create_connection(("localhost", port), timeout=1.0):
            return f"http://localhost:{port}"
        time.sleep(0.1)
    raise TimeoutError("no page is served")
