// Numbers of a target that a hand moves: those that it does not touch stay exactly as they were sent.

const NEAR = 1e-3; // m, rad or of a quaternion: a robot at rest is that near to its target
const ROUNDING = 2e-6; // of numbers in frames, twice

const near = (one, other, sign = 1) => Math.abs(one - sign * other) < NEAR;

/**
 * Where a target is when it is gripped: as it was sent last, where the robot is there.
 *
 * @param {number[]} shown numbers of the newest frame; from `plain` on a quaternion
 * @param {number[]} asked those that were sent last
 * @param {number} plain
 */
export function gripped(shown, asked = shown, plain = shown.length) {
  const sign = Math.sign(shown.slice(plain).reduce((sum, each, i) => sum + each * asked[plain + i], 0));
  const turned = shown.slice(plain).every((each, i) => near(each, asked[plain + i], sign)); // q and −q are one
  const stays = (each, i) => (i < plain ? near(each, asked[i]) : turned);
  return { shown, plain, sent: shown.map((each, i) => (stays(each, i) ? asked[i] : each)) };
}

/** The numbers of now, each moved by as much as what is shown has moved since it was gripped. */
export function moved(now, { shown, plain, sent }) {
  const moves = now.map((each, i) => Math.abs(each - shown[i]) >= ROUNDING);
  const turns = moves.slice(plain).includes(true);
  return now.map((each, i) => {
    if (i >= plain) return turns ? each : sent[i];
    return moves[i] ? sent[i] + each - shown[i] : sent[i];
  });
}
