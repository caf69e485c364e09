"""One page of an evaluation of video: the last true frame of each clip beside that of each row."""

from __future__ import annotations

import numpy as np

from evs.drivers.pictures.text_lines import paste, text_line
from evs.msgs.pictures import PAPER, U8
from evs_lab.evaluation.claims import NOTHING, REFERENCE
from evs_lab.evaluation.reconstruct import TRUTH, VideoCell, VideoEvaluation

ACROSS = 7
"""pictures in a line"""
GAP_PX, HEADING_PX, CAPTION_PX = 8, 16, 12
_HEADING_ROWS, _CAPTION_ROWS = 26, 20


def video_page(found: VideoEvaluation) -> U8:
    """(height, width, 3): a block for each clip and reconstructor."""
    blocks: dict[str, list[VideoCell]] = {}
    for cell in found.cells:
        blocks.setdefault(f"{cell.scene}, camera {cell.camera}", []).append(cell)
    parts = [
        _block(f"{name}: {clip}", name, cells)
        for clip, cells in blocks.items()
        for name in found.reconstructors
    ]
    return np.concatenate(parts)


def _block(title: str, reconstructor: str, cells: list[VideoCell]) -> U8:
    height, width = cells[0].pictures[reconstructor].shape
    down = -(-len(cells) // ACROSS)
    line = height + _CAPTION_ROWS
    across = GAP_PX + ACROSS * (width + GAP_PX)
    page = np.full((_HEADING_ROWS + down * line, across, 3), PAPER, np.uint8)
    paste(page, text_line(title, HEADING_PX).picture[:_HEADING_ROWS], GAP_PX, 0)
    for k, cell in enumerate(cells):
        grey = np.rint(255 * cell.pictures[reconstructor]).astype(np.uint8)
        left, top = GAP_PX + k % ACROSS * (width + GAP_PX), _HEADING_ROWS + k // ACROSS * line
        paste(page, np.repeat(grey[:, :, np.newaxis], 3, axis=2), left, top)
        caption = text_line(_words(cell), CAPTION_PX).picture[:_CAPTION_ROWS, : width + GAP_PX]
        paste(page, caption, left, top + height)
    return page


def _words(cell: VideoCell) -> str:
    fixed = {TRUTH: "true frame", REFERENCE: REFERENCE, NOTHING: "no events"}
    return fixed.get(cell.model, f"{cell.model}, {cell.light}")
