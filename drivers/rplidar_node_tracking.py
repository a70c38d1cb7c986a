"""Where standard nodes lie in a stream: they have two bits of redundancy, so the head's motion must vouch for them.

A node's angle is the head's less the triangulation's, which depends on the distance. Three readings of that are
followed at once: as a real A2 writes nodes (nothing to subtract where there is no distance), with 7.5 deg subtracted
there, and plain head angles. The one in which the head turns most smoothly judges the next node; how far that may be
off is what the stream itself has shown, at least 1.5 deg. All angles here are in 1/64 deg ("q6").
"""

from __future__ import annotations

import numpy as np
from numba import njit

from drivers.messages import FloatArray
from drivers.rplidar_capsules import IntArray

NODE = 5  # bytes
LOCK_FRAMES = 12  # a chain of them turns by 8 deg at the slowest: another field misread as an angle does not
_RESUME_FRAMES, _LIKELY_FRAMES = 3, 2  # suffice where the head is expected, and where the very byte is
_RESUME_BYTES = 100  # so far behind the damage
_ONE_LESS, _ONE_MORE = 2 * NODE - 1, 2 * NODE + 1  # to the next node but one, past one with a byte off

FRESH, LOCKED, LOST, COLD = 0, 1, 2, 3
# The state: what is done; whether the pending node was found to fit, and whether the one where the step was lost did;
# for each reading of the angles the head, its step from node to node, and the nodes' mean distance from it.
_DOING, _VOUCHED, _DOUBTFUL, _HEAD, _STEP, _ERROR, STATE_SIZE = 0, 1, 2, 3, 6, 9, 12
_READINGS = 3
_SOUND, _DAMAGED, _ADRIFT, _WAIT = 0, 1, 2, -1

_TURN = 360 * 64.0
_FLAG_WINDOW = 20 * 64  # a turn begins near 0 deg
_MAX_STEP = 16 * 64.0  # in a chain: 2.7 deg at 15 Hz and up to 8 deg of triangulation
_MIN_ADVANCE = 64.0  # over a chain: a constant byte misread as an angle does not advance
_TOLERANCE, _TOLERANCE_GROWTH, _TOLERANCE_BASE = 96.0, 4.0, 32.0
_HEAD_GAIN, _STEP_GAIN, _ERROR_GAIN = 0.25, 0.01, 1 / 32
_UNKNOWN_OFFSET = 480.0  # 7.5 deg
_RAD_Q16_TO_Q6 = 180.0 / 3.14159265 / 1024.0


def fresh_state() -> FloatArray:
    """Return the state at the start of a stream, whose first byte begins a node."""
    return np.zeros(STATE_SIZE, dtype=np.float64)


@njit(cache=True, nogil=True)
def find_nodes(stream: bytes, state: FloatArray, runs: IntArray) -> tuple[int, int]:
    """Write runs of sound nodes (start, count) to runs (R, 2); return how many runs, and the bytes settled.

    What is decided at a byte depends on the state and on bytes after it, for which the search waits where they have
    not come; so the same nodes are found however the stream is cut.
    """
    count, at = 0, 0
    while True:
        if state[_DOING] == LOCKED:
            followed = _stride(stream, at, state)
            count = _append(runs, count, at, (followed - at) // NODE)
            at = followed
            verdict = _judge(stream, at, state)
            if verdict == _WAIT:
                return count, at
            count = _append(runs, count, at, int(verdict == _SOUND))
            at += 0 if verdict == _ADRIFT else NODE
        elif state[_DOING] == LOST:
            following = _resume(stream, at, state)
            if following == _WAIT:
                return count, at
            count = _append(runs, count, at, int(state[_DOUBTFUL]))
            at = following
        else:
            at = _lock_on(stream, at, state)
            if state[_DOING] != LOCKED:
                return count, at


@njit(cache=True, nogil=True)
def _stride(stream: bytes, at: int, state: FloatArray) -> int:
    """Follow nodes as long as each fits and the next one too; return the first that has not been followed."""
    if at + 2 * NODE > len(stream) or not (state[_VOUCHED] or _fits(stream, at, state, 1)):
        return at
    angle, offset = _angle(stream, at), _offset(stream, at)
    while at + 2 * NODE <= len(stream) and _is_sound(stream, at + NODE):
        next_angle, next_offset = _angle(stream, at + NODE), _offset(stream, at + NODE)
        reading = _best(state)
        expected = state[_HEAD + reading] + 2 * state[_STEP + reading]
        if abs(_turned(_read(next_angle, next_offset, reading) - expected)) > _tolerance(state, reading):
            break
        _follow(angle, offset, state)
        state[_VOUCHED] = 1.0
        at += NODE
        angle, offset = next_angle, next_offset
    return at


@njit(cache=True, nogil=True)
def _judge(stream: bytes, at: int, state: FloatArray) -> int:
    """Judge the node expected here by itself and by the next; where one is unsound, two more say if bytes are lost.

    Unless it has to wait for bytes, the state goes on by this node.
    """
    if at + 2 * NODE > len(stream):
        return _WAIT
    here = state[_VOUCHED] != 0.0 or _fits(stream, at, state, 1)
    behind = _fits(stream, at + NODE, state, 2)
    if here and behind:
        verdict = _SOUND
    else:
        first = at + NODE if not here else at + 2 * NODE
        if first + 2 * NODE > len(stream):
            return _WAIT
        ahead = (first - at) // NODE + 1
        verdict = _ADRIFT
        if _fits(stream, first, state, ahead) and _fits(stream, first + NODE, state, ahead + 1):
            verdict = _SOUND if here else _DAMAGED
    state[_VOUCHED], state[_DOUBTFUL] = 0.0, 1.0 if here else 0.0
    if verdict == _SOUND:
        _follow(_angle(stream, at), _offset(stream, at), state)
    elif verdict == _DAMAGED:
        _pass_over(stream, at, state)
    else:
        state[_DOING] = LOST
    return verdict


@njit(cache=True, nogil=True)
def _resume(stream: bytes, lost_at: int, state: FloatArray) -> int:
    """Lock on again behind the node at lost_at, near where the head must be, or go hunting; return where to go on.

    Leaves state[_DOUBTFUL] if the node at lost_at was sound: it is, where the damage lies in the next one.
    """
    distance, frames = _find_again(stream, lost_at, state)
    if distance == _WAIT:
        return _WAIT
    if not _ONE_LESS <= distance <= _ONE_MORE:
        state[_DOUBTFUL] = 0.0
    if distance == 0:
        state[_DOING] = COLD
        return lost_at + 1
    at = lost_at + distance
    state[_DOING] = LOCKED
    _set_head(stream, at, state, frames)
    if not _is_whole(distance):
        return at + NODE
    _step_back(state)
    return at


@njit(cache=True, nogil=True)
def _find_again(stream: bytes, lost_at: int, state: FloatArray) -> tuple[int, int]:
    """Return how far behind the node at lost_at sound ones go on, 0 for nowhere near, and how many show that.

    Two suffice where one byte missing or too many in the node between would put them, if nothing better is near: the
    third may be damaged again.
    """
    for distance in range(1, _RESUME_BYTES + 1):
        if lost_at + distance + _RESUME_FRAMES * NODE > len(stream):
            return _WAIT, 0
        if _goes_on(stream, lost_at, distance, state, _RESUME_FRAMES):
            return distance, _RESUME_FRAMES
        if distance == _ONE_MORE:
            for likely in (_ONE_LESS, _ONE_MORE):
                if _goes_on(stream, lost_at, likely, state, _LIKELY_FRAMES):
                    return likely, _LIKELY_FRAMES
    return 0, 0


@njit(cache=True, nogil=True)
def _goes_on(stream: bytes, lost_at: int, distance: int, state: FloatArray, frames: int) -> bool:
    """Are there so many sound nodes in a row, so far behind the one at lost_at, where the head must be by then?"""
    at, reading = lost_at + distance, _best(state)
    step, tolerance = state[_STEP + reading], _tolerance(state, reading)
    off = abs(_residual(stream, at, state, reading, distance / NODE + 1))
    if not _is_sound(stream, at) or off > tolerance + abs(step):
        return False
    head = _head(stream, at, reading)
    for frame in range(1, frames):
        next_at = at + frame * NODE
        off = abs(_turned(_head(stream, next_at, reading) - head - frame * step))
        if not _is_sound(stream, next_at) or off > tolerance:
            return False
    return True


@njit(cache=True, nogil=True)
def _is_whole(distance: int) -> bool:
    """Is the first node found so far behind the last one whole? Else it may straddle the damage and only vouches.

    It is where no byte is missing or too many. Damage begins in the last node or in the next, so the one after that is
    whole too, unless it has damage of its own: even then its distance is in one piece and its angle fits.
    """
    return distance % NODE == 0 or distance >= 2 * NODE - 2


@njit(cache=True, nogil=True)
def _is_chain(stream: bytes, start: int) -> bool:
    """Is this the start of LOCK_FRAMES sound nodes that turn by small steps and advance as a whole?"""
    for frame in range(LOCK_FRAMES):
        at = start + frame * NODE
        if not _is_sound(stream, at):
            return False
        if frame and abs(_turned(_angle(stream, at) - _angle(stream, at - NODE))) > _MAX_STEP:
            return False
    last = start + (LOCK_FRAMES - 1) * NODE
    return _turned(_angle(stream, last) - _angle(stream, start)) >= _MIN_ADVANCE


@njit(cache=True, nogil=True)
def _lock_on(stream: bytes, at: int, state: FloatArray) -> int:
    """Lock on to the first chain from `at` on; return where to go on, with what state[_DOING] says."""
    fresh = state[_DOING] == FRESH
    while at + LOCK_FRAMES * NODE <= len(stream):
        if not _is_chain(stream, at):
            fresh, state[_DOING] = False, COLD
            at += 1
            continue
        _learn(stream, at, state)
        state[_DOING] = LOCKED
        if fresh:
            _step_back(state)
            return at
        return at + NODE  # the first may straddle damage: it only vouches for the second
    return at


@njit(cache=True, nogil=True)
def _learn(stream: bytes, start: int, state: FloatArray) -> None:
    """Take head, step and error of every reading from a chain; the head is the first node's."""
    for reading in range(_READINGS):
        turned = np.zeros(LOCK_FRAMES)
        for frame in range(1, LOCK_FRAMES):
            at = start + frame * NODE
            turned[frame] = turned[frame - 1] + _turned(_head(stream, at, reading) - _head(stream, at - NODE, reading))
        index = np.arange(LOCK_FRAMES) - (LOCK_FRAMES - 1) / 2
        step = (index * turned).sum() / (index**2).sum()
        line = turned.mean() + step * index
        state[_STEP + reading] = step
        state[_HEAD + reading] = _head(stream, start, reading) + line[0]
        state[_ERROR + reading] = np.abs(turned - line).mean()


@njit(cache=True, nogil=True)
def _step_back(state: FloatArray) -> None:
    """Let the node that head and step were taken from be the one that comes next."""
    for reading in range(_READINGS):
        state[_HEAD + reading] -= state[_STEP + reading]


@njit(cache=True, nogil=True)
def _set_head(stream: bytes, at: int, state: FloatArray, frames: int) -> None:
    """Put the head of every reading to where so many nodes found again have it."""
    for reading in range(_READINGS):
        head, off = _head(stream, at, reading), 0.0
        for frame in range(1, frames):
            off += _turned(_head(stream, at + frame * NODE, reading) - head - frame * state[_STEP + reading])
        state[_HEAD + reading] = head + off / frames


@njit(cache=True, nogil=True)
def _follow(angle: float, offset: float, state: FloatArray) -> None:
    """Let every reading learn from the sound node that comes next."""
    for reading in range(_READINGS):
        expected = state[_HEAD + reading] + state[_STEP + reading]
        off = _turned(_read(angle, offset, reading) - expected)
        off = min(max(off, -_MAX_STEP), _MAX_STEP)
        state[_HEAD + reading] = _turned(expected + _HEAD_GAIN * off)
        state[_STEP + reading] += _STEP_GAIN * off
        state[_ERROR + reading] += _ERROR_GAIN * (abs(off) - state[_ERROR + reading])


@njit(cache=True, nogil=True)
def _pass_over(stream: bytes, at: int, state: FloatArray) -> None:
    """Let the head turn past a damaged node. One that is well but for its angle may show that tolerances are small."""
    sound = _is_sound(stream, at)
    for reading in range(_READINGS):
        off = min(abs(_residual(stream, at, state, reading, 1.0)), _MAX_STEP)
        if sound:
            state[_ERROR + reading] += _ERROR_GAIN * (off - state[_ERROR + reading])
        state[_HEAD + reading] = _turned(state[_HEAD + reading] + state[_STEP + reading])


@njit(cache=True, nogil=True)
def _fits(stream: bytes, at: int, state: FloatArray, ahead: int) -> bool:
    if not _is_sound(stream, at):
        return False
    reading = _best(state)
    return abs(_residual(stream, at, state, reading, float(ahead))) <= _tolerance(state, reading)


@njit(cache=True, nogil=True)
def _best(state: FloatArray) -> int:
    best = 0
    for reading in range(1, _READINGS):
        if state[_ERROR + reading] < state[_ERROR + best]:
            best = reading
    return best


@njit(cache=True, nogil=True)
def _tolerance(state: FloatArray, reading: int) -> float:
    grown = _TOLERANCE_GROWTH * state[_ERROR + reading] + _TOLERANCE_BASE
    tolerance: float = min(max(grown, _TOLERANCE), _MAX_STEP)
    return tolerance


@njit(cache=True, nogil=True)
def _residual(stream: bytes, at: int, state: FloatArray, reading: int, ahead: float) -> float:
    return _turned(_head(stream, at, reading) - state[_HEAD + reading] - ahead * state[_STEP + reading])


@njit(cache=True, nogil=True)
def _is_sound(stream: bytes, at: int) -> bool:
    """Are the check bits right, the angle below a turn, and a turn's flag only raised near 0 deg?"""
    first = stream[at]
    angle = _angle(stream, at)
    if (first ^ (first >> 1)) & 1 == 0 or stream[at + 1] & 1 == 0 or angle >= _TURN:
        return False
    return first & 1 == 0 or angle < _FLAG_WINDOW or angle > _TURN - _FLAG_WINDOW


@njit(cache=True, nogil=True)
def _head(stream: bytes, at: int, reading: int) -> float:
    return _read(_angle(stream, at), _offset(stream, at), reading)


@njit(cache=True, nogil=True)
def _read(angle: float, offset: float, reading: int) -> float:
    """Return the head's angle by a reading of a node: 0 as a real A2, 1 with a guess for no distance, 2 plain."""
    if reading == 2:
        return angle
    if offset < 0:
        return angle + (_UNKNOWN_OFFSET if reading == 1 else 0.0)
    return angle + offset


@njit(cache=True, nogil=True)
def _offset(stream: bytes, at: int) -> float:
    """Return what triangulation subtracts at the node's distance, as in ultra capsules; below 0 where there is none."""
    distance_q2 = np.int64(stream[at + 3]) | np.int64(stream[at + 4]) << 8
    if distance_q2 < 200:
        return -1.0
    reciprocal = 98361.0 / distance_q2
    offset: float = (9150.0 - 64.0 * reciprocal - reciprocal * reciprocal * reciprocal * (1 / 98304)) * _RAD_Q16_TO_Q6
    return offset


@njit(cache=True, nogil=True)
def _angle(stream: bytes, at: int) -> float:
    return float((np.int64(stream[at + 1]) >> 1) | (np.int64(stream[at + 2]) << 7))


@njit(cache=True, nogil=True)
def _turned(angle: float) -> float:
    """Bring a turn to within half a turn."""
    turned: float = angle - _TURN * np.floor(angle / _TURN + 0.5)
    return turned


@njit(cache=True, nogil=True)
def _append(runs: IntArray, count: int, at: int, nodes: int) -> int:
    if nodes == 0:
        return count
    if count and runs[count - 1, 0] + NODE * runs[count - 1, 1] == at:
        runs[count - 1, 1] += nodes
        return count
    runs[count, 0], runs[count, 1] = at, nodes
    return count + 1
