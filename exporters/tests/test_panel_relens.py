"""Live re-lens: one job at a time, the last change wins, drafts while the lens changes, a final one when it rests."""

import unittest

from blender.outcome import Outcome
from blender.relens import Level, Relens
from blender.shared import ExportError

DRAFT, FINAL = Level.DRAFT, Level.FINAL
SETTLE_S = 0.5


class FakeJob:
    def __init__(self) -> None:
        self.outcome: Outcome | None = None
        self.is_stopped = False

    def poll(self) -> Outcome | None:
        return self.outcome

    def stop(self) -> None:
        self.is_stopped = True


class Watched(unittest.TestCase):
    def setUp(self) -> None:
        self.started: list[tuple[str, Level]] = []
        self.jobs: list[FakeJob] = []
        self.relens = Relens(self.start, SETTLE_S)

    def start(self, lens: str, level: Level) -> FakeJob:
        self.assertTrue(all(job.outcome or job.is_stopped for job in self.jobs), "two jobs at a time")
        self.started.append((lens, level))
        self.jobs.append(FakeJob())
        return self.jobs[-1]

    def end(self, is_done: bool = True) -> None:
        self.jobs[-1].outcome = Outcome(is_done, "end")

    def test_a_lens_that_rests_is_drafted_then_finished_then_left_alone(self) -> None:
        self.relens.tick("a", 0.0)
        self.end()
        self.assertEqual(self.relens.tick("a", 0.1), Outcome(True, "end"))
        self.assertEqual(self.started, [("a", DRAFT)])
        self.relens.tick("a", 0.5)
        self.end()
        self.relens.tick("a", 0.6)
        self.relens.tick("a", 9.0)
        self.assertEqual(self.started, [("a", DRAFT), ("a", FINAL)])
        self.assertTrue(self.relens.is_settled("a"))

    def test_changes_during_a_draft_are_skipped_but_for_the_last(self) -> None:
        for number, lens in enumerate("abcd"):
            self.relens.tick(lens, 0.1 * number)
        self.assertEqual(self.started, [("a", DRAFT)])
        self.assertFalse(self.jobs[0].is_stopped)
        self.end()
        self.assertIsNotNone(self.relens.tick("d", 0.4))
        self.assertEqual(self.started, [("a", DRAFT), ("d", DRAFT)])

    def test_a_final_picture_of_a_lens_that_is_no_more_is_given_up(self) -> None:
        self.relens.tick("a", 0.0)
        self.end()
        self.relens.tick("a", 1.0)
        self.assertEqual(self.started[-1], ("a", FINAL))
        self.assertIsNone(self.relens.tick("b", 1.1))
        self.assertTrue(self.jobs[1].is_stopped)
        self.assertEqual(self.started[-1], ("b", DRAFT))

    def test_a_slow_draft_of_a_lens_that_rests_is_followed_by_the_final_one(self) -> None:
        self.relens.tick("a", 0.0)
        self.relens.tick("a", 3.0)
        self.assertFalse(self.relens.is_settled("a"))
        self.end()
        self.relens.tick("a", 3.1)
        self.assertEqual(self.started, [("a", DRAFT), ("a", FINAL)])

    def test_a_lens_that_comes_back_is_rendered_again(self) -> None:
        for number, lens in enumerate("aba"):
            self.relens.tick(lens, number)
            self.end()
            self.relens.tick(lens, number + 0.1)
        self.assertEqual(self.started, [("a", DRAFT), ("b", DRAFT), ("a", DRAFT)])

    def test_a_lens_that_failed_is_not_tried_again_until_it_changes(self) -> None:
        self.relens.tick("a", 0.0)
        self.end(is_done=False)
        self.assertFalse(self.relens.tick("a", 0.1).is_done)
        self.relens.tick("a", 5.0)
        self.assertEqual(self.started, [("a", DRAFT)])
        self.relens.tick("b", 6.0)
        self.assertEqual(self.started[-1], ("b", DRAFT))

    def test_a_job_that_cannot_start_is_said_once(self) -> None:
        def start(lens: str, level: Level) -> FakeJob:
            self.started.append((lens, level))
            raise ExportError("no program")

        relens = Relens(start, SETTLE_S)
        self.assertEqual(relens.tick("a", 0.0), Outcome(False, "error: no program"))
        self.assertIsNone(relens.tick("a", 5.0))
        self.assertEqual(len(self.started), 1)

    def test_without_a_lens_nothing_runs(self) -> None:
        self.relens.tick("a", 0.0)
        self.relens.tick(None, 0.1)
        self.assertTrue(self.jobs[0].is_stopped)
        self.relens.tick(None, 9.0)
        self.assertEqual(len(self.started), 1)

    def test_a_stop_ends_the_job(self) -> None:
        self.relens.tick("a", 0.0)
        self.relens.stop()
        self.assertTrue(self.jobs[0].is_stopped)
        self.assertFalse(self.relens.is_busy)


if __name__ == "__main__":
    unittest.main()
