"""Eight springs in lock-step, by vector instructions: how a diagnosis computes thousands of replays."""
