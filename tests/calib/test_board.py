"""The lens of a simulated camera from rendered boards."""

import json

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

import roadfiber.command
from calib.board import Board, BoardView, draw_board, find_board, fit_board
from calib.lens_prior import read_intrinsics
from vision.contract import InputError
from vision.lens import NAMES, Lens

SIZE = (640, 480)
LENS = Lens(focal=(520, 524), center=(326, 236), distortion=(-0.22, 0.07, 8e-4, -6e-4, -0.01))
CHARUCO, PLAIN = Board(9, 6), Board(9, 6, markers=None)
POSES = [  # turn of the board (rad), and where its middle is (squares from the camera)
    ((0.0, 0.0, 0.0), (0, 0, 8)),
    ((0.5, 0.0, 0.1), (-2.2, -1.5, 9)),
    ((-0.5, 0.1, 0.0), (2.2, 1.5, 9)),
    ((0.0, 0.6, 0.2), (2.2, -1.5, 9)),
    ((0.1, -0.6, -0.1), (-2.2, 1.5, 9)),
    ((0.4, 0.4, 1.5), (0, 0, 9)),
    ((-0.4, 0.4, 0.3), (1.5, 0, 7)),
    ((0.3, -0.4, -0.4), (-1.5, 0, 7)),
]


def pixel_rays():
    u, v = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    ideal = LENS.undistort(np.stack([u, v], axis=-1).reshape(-1, 2))
    return (ideal - LENS.center) / LENS.focal


RAYS = pixel_rays()


def render(board, turn, middle):
    """Picture of a board: every pixel's ray meets the board's plane."""
    face, scale = draw_board(board, 60), 60
    rotation = cv2.Rodrigues(np.array(turn, float))[0]
    normal, rays = rotation[:, 2], np.column_stack([RAYS, np.ones(len(RAYS))])
    depth = (normal @ np.array(middle)) / (rays @ normal)
    on_board = (rays * depth[:, None] - middle) @ rotation[:, :2] + (board.columns / 2, board.rows / 2)
    # The face has a margin of half a square; OpenCV's pixels have their middles at whole numbers.
    place = ((on_board + 0.5) * scale - 0.5).astype(np.float32).reshape(SIZE[1], SIZE[0], 2)
    face = cv2.GaussianBlur(face, (0, 0), 1.0)
    seen = cv2.remap(face, place[..., 0], place[..., 1], cv2.INTER_LINEAR, borderValue=128)
    noise = np.random.default_rng(0).normal(0, 2, seen.shape)
    return np.clip(seen[..., None] + noise[..., None], 0, 255).astype(np.uint8).repeat(3, axis=2)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("board")
    for index, pose in enumerate(POSES):
        cv2.imwrite(str(folder / f"view_{index}.png"), render(CHARUCO, *pose))
    return folder


def run(*arguments):
    return CliRunner().invoke(roadfiber.command.app, ["calibrate", "board", *map(str, arguments)])


def test_the_lens_comes_back_within_its_sigma(pictures, tmp_path):
    out = tmp_path / "intrinsics.json"
    result = run(pictures, "--out", out, "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert len(found["views"]) == len(POSES) and found["rms_px"] < 0.3 and found["coverage"] > 0.6
    assert max(row["tilt_deg"] for row in found["views"]) > 25
    intrinsics = read_intrinsics(out)
    off = (intrinsics.lens.vector - LENS.vector) / np.sqrt(np.diagonal(intrinsics.covariance))
    assert np.abs(off).max() < 4, dict(zip(NAMES, off.round(1), strict=True))
    assert intrinsics.lens.focal == pytest.approx(LENS.focal, rel=0.005)
    assert intrinsics.lens.center == pytest.approx(LENS.center, abs=1.5)
    assert cv2.imread(str(out.with_suffix(".png"))) is not None


def test_the_prior_is_the_covariance():
    intrinsics = fit_board(corner_views(POSES), SIZE).intrinsics
    prior = intrinsics.prior(SIZE, "i.json")
    np.testing.assert_allclose(prior.factor @ prior.factor.T, intrinsics.covariance, rtol=1e-4, atol=1e-12)
    with pytest.raises(InputError, match="is of 640x480 pictures but the video is 1280x720"):
        intrinsics.prior((1280, 720), "i.json")


def test_a_checkerboard_is_found_where_it_is():
    turn, middle = POSES[1]
    view = find_board(render(PLAIN, turn, middle), PLAIN)
    corners = view.places[:, :2] + 1 - (4.5, 3)
    places = np.column_stack([corners, np.zeros(len(corners))]) @ cv2.Rodrigues(np.array(turn))[0].T + middle
    seen = LENS.distort(places[:, :2] / places[:, 2:] * LENS.focal + LENS.center)
    order = np.linalg.norm(seen[:, None] - view.pixels, axis=2).argmin(axis=1)
    assert len(view.pixels) == PLAIN.corners() and len(set(order)) == len(order)
    assert np.linalg.norm(seen - view.pixels[order], axis=1).max() < 0.5


def corner_views(poses, noise=0.1, seed=0):
    """Views as points, without pictures."""
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(1, 9), np.arange(1, 6)), axis=-1).reshape(-1, 2).astype(float)
    views = []
    for index, (turn, middle) in enumerate(poses):
        flat = np.column_stack([grid - (4.5, 3), np.zeros(len(grid))])
        places = flat @ cv2.Rodrigues(np.array(turn, float))[0].T + middle
        pixels = LENS.distort(places[:, :2] / places[:, 2:] * LENS.focal + LENS.center)
        views.append(BoardView(f"v{index}", flat, pixels + noise * rng.normal(size=pixels.shape)))
    return views


def test_stated_sigmas_are_those_that_happen():
    off = []
    for seed in range(20):
        found = fit_board(corner_views(POSES, seed=seed), SIZE).intrinsics
        off.append((found.lens.vector - LENS.vector) / np.sqrt(np.diagonal(found.covariance)))
    assert 0.7 < np.std(off) < 1.3


def test_a_spoiled_view_is_left_out_and_named():
    views = corner_views(POSES)
    noise = np.random.default_rng(9).normal(0, 3, views[2].pixels.shape)
    views[2] = BoardView("shaken", views[2].places, views[2].pixels + noise)
    fit = fit_board(views, SIZE)
    assert len(fit.views) == len(POSES) - 1 and "left out, badly fitting: shaken" in fit.warnings[0]


def test_weak_sets_of_views_are_warned_of():
    flat = [((0.02 * k, 0, 0), (0.1 * k, 0, 9 + k)) for k in range(4)]
    messages = " ".join(fit_board(corner_views(flat), SIZE).warnings)
    assert "only 4 views" in messages and "no board is tilted" in messages and "of the picture" in messages


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "no pictures given"),
        (["--squares", "nine"], "--squares: give WIDTHxHEIGHT"),
        (["--kind", "dots"], "--kind dots: give one of charuco, checkerboard"),
        (["absent.png"], "absent.png: no such file"),
        (["{folder}", "--markers", "9X9"], "no such dictionary; give one of 4X4_100"),
        (["{folder}", "--markers", "7X7_50"], "the board was found in 0 of 8"),
    ],
)
def test_bad_input_is_one_line(pictures, tmp_path, arguments, message):
    out = tmp_path / "i.json"
    result = run(*[word.format(folder=pictures) for word in arguments], "--out", out)
    assert isinstance(result.exception, InputError) and message in str(result.exception)
    assert not out.exists()


def test_it_draws_a_board_that_it_finds(tmp_path):
    assert run("--draw", tmp_path / "b.png").exit_code == 0
    view = find_board(cv2.imread(str(tmp_path / "b.png")), CHARUCO)
    assert len(view.pixels) == CHARUCO.corners()
