"""octoplan live: a page on which the scene's target is dragged, and the arm follows."""

from __future__ import annotations

import sys
from dataclasses import replace

from planner.commands.answer import OK, Answer
from planner.commands.options import Accuracy, SceneFile, check_plannable
from planner.io.scene_file import load
from planner.live.handles import handle_of
from planner.live.page import Page
from planner.live.session import Session


def live(
    scene: SceneFile,
    /,
    *,
    host: str = "localhost",
    port: int = 8080,
    accuracy: Accuracy | None = None,
    compile: bool = False,  # noqa: A002  (the name of the option)
) -> Answer:
    """Open a page on which the scene's target is dragged and the arm follows.

    It is served until the last browser that looked at it is gone.

    Parameters
    ----------
    host
        Where the page is served (localhost).
    port
        Its port (8080).
    compile
        Work by machine code, see octoplan plan.
    """
    question = load(scene)
    check_plannable(question, scene)
    if accuracy is not None:
        question = replace(question, accuracy=accuracy)
    machine_code = compile or question.compile
    given = question.options | {"accuracy": question.accuracy, "compile": machine_code}
    handle = handle_of(question.arm, question.targets)
    page = Page(Session(question.arm, question.scene, handle, given), host, port)
    sys.stderr.write(f"octoplan: http://{host}:{port} (ends with the last browser)\n")
    page.wait()
    page.end()
    return Answer(OK, lambda: "The last browser is gone.")
