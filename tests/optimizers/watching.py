"""An advisor for tests of what advisors are shown."""

from swim2real.optimizers import ScriptedAdvisor, Situation


class Watching(ScriptedAdvisor):
    """A scripted advisor that keeps what it was shown."""

    def __init__(self, advice):
        super().__init__(advice)
        self.shown: list[Situation] = []

    def propose(self, situation):
        self.shown.append(situation)
        return super().propose(situation)
