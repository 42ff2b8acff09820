"""Both ends of the footprint stay within the corridor (13)."""

from sidestep.plant_models.kernels import Record, kernel


@kernel
def corridor(i: int, w: Record, c: Record) -> int:
    """Fill lines l + lever e_phi of the footprint's front and rear, softened by slack 0.

    Args:
        i: First free line.
        w: Work space, condensed; `bounds` holds right and left at the front, right and left at the rear, in [m];
            `lines`, `slopes`, `low`, `high` and `slack` are filled.
        c: Settings; nodes before `grid.first` are too near for steering to matter.

    Returns:
        The next free line.
    """
    grid = c.grid
    for k in range(grid.first, grid.nodes):
        for end in range(2):
            lever = grid.levers[end]
            w.lines[i] = w.free[k, 0] + lever * w.free[k, 1]
            for q in range(grid.moves):
                w.slopes[i, q] = w.response[k, 0, q] + lever * w.response[k, 1, q]
            w.low[i], w.high[i], w.slack[i] = w.bounds[2 * end, k], w.bounds[2 * end + 1, k], 0
            i += 1
    return i
