"""The process that works for a page: what is quick does not wait for what may take its time."""

import logging
import queue
import threading
from types import SimpleNamespace

from roadfiber.web.worker import Answers, in_turn

PATIENCE = 30.0


class Line:
    """What is sent, in turn."""

    def __init__(self):
        self.sent = queue.Queue()

    def send(self, words):
        self.sent.put(words)


def test_a_quick_task_does_not_wait_for_one_at_leisure_and_all_others_do():
    line, asked, gone_on = Line(), queue.Queue(), threading.Event()

    def slow(tell):
        assert gone_on.wait(PATIENCE)
        return "slow"

    tasks = SimpleNamespace(
        AT_LEISURE={"slow"}, MEANWHILE={"quick"}, slow=slow, quick=lambda tell: "quick", other=lambda tell: "other"
    )
    answers = Answers(line, logging.getLogger("tests.worker"))
    threading.Thread(target=in_turn, args=(asked, tasks, answers), daemon=True).start()
    for number, name in enumerate(("slow", "quick", "other")):
        asked.put((number, name, ()))
    assert line.sent.get(timeout=PATIENCE) == (1, "done", "quick")
    assert line.sent.empty(), "the others wait"
    gone_on.set()
    assert [line.sent.get(timeout=PATIENCE)[2] for _ in range(2)] == ["slow", "other"]
