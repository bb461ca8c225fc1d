"""A transcript keeps what no JSON file of ours may hold, replaced, so that it can be read again."""

import numpy as np

from swim2real.advisor.vlm.exchange import Attempt, Reply, Request
from swim2real.advisor.vlm.transcript import Call, Incumbent, Transcript


def test_a_reply_with_a_nul_or_half_a_character_is_read_again(tmp_path):
    attempts = (Attempt(1.0),)
    reply = Reply("a\0b\ud800c ü 鱼", "stop", "model\0", 1, 1, None, attempts=attempts)
    incumbent = Incumbent(tuple(np.full(2, 0.5).tolist()), 0.1)
    call = Call(0, 1, False, "openai:some", "used", None, incumbent, reply, attempts)
    written = Transcript(tmp_path).write(call, Request("Look.", ("Text",), {}, 1000, 1, ""))
    assert written.reply.text == "a\ufffdb?c ü 鱼"
    assert Transcript(tmp_path).of_round(1)[0].reply.model == "model\ufffd"
