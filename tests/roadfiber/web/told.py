"""A worker that keeps what it was asked, and answers as a test tells it."""

from types import SimpleNamespace


class Told:
    """Stands in for `roadfiber.web.worker.Worker`."""

    def __init__(self, name):
        self.asked, self.stopped = [], False

    def ask(self, task, *given, then, told=None, failed=None):
        self.asked.append(SimpleNamespace(task=task, given=given, then=then, told=told, failed=failed))

    def stop(self):
        self.stopped = True
