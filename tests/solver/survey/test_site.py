import datetime

import pytest

from solver.survey.site import read_site
from solver.survey.site_sections import DETECTORS
from vision.contract import InputError, LocalFrame
from vision.detectors.onnx_detector import BUILT_IN

FRAME = "[frame]\norigin = [32.113, 34.804]\nx_azimuth = 78.0\n"
DAS = '[das]\nfiles = ["das/*.h5"]\n'
TRACKS = '[trajectories]\nfiles = ["tracks.csv"]\n'
CAMERA = '[camera]\nvideo = "street.mp4"\ncalibration = "camera.json"\nstart = 2025-08-11T08:00:00+02:00\n'


@pytest.fixture
def folder(tmp_path):
    for name in ("das/b.h5", "das/a.h5", "tracks.csv", "street.mp4", "camera.json", "anchors.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def site_of(folder, *sections):
    (folder / "site.toml").write_text("".join(sections))
    return read_site(folder / "site.toml")


def test_defaults(folder):
    site = site_of(folder, FRAME, DAS, TRACKS)
    assert site.name == folder.name
    assert site.frame == LocalFrame((32.113, 34.804), 78.0)
    assert site.das.files == [folder / "das/a.h5", folder / "das/b.h5"]
    assert (site.das.gauge_length, site.das.channels, site.das.quantity) == (None, None, None)
    assert site.trajectories is not None
    assert site.trajectories.files == [folder / "tracks.csv"]
    assert (site.camera, site.anchors) == (None, None)
    assert (site.ground.poisson_ratio, site.ground.depth) == (0.25, (0.9, 0.3))


def test_everything(folder):
    das = DAS + 'gauge_length = 10\nchannel_spacing = 1.021\nquantity = "phase"\nscale = 1e-4\n'
    rest = 'channels = [70, 170]\nexclude = [99]\n[anchors]\nfile = "anchors.csv"\n[ground]\ndepth = [1.2, 0.2]\n'
    site = site_of(folder, 'name = "Herzl street"\n', FRAME, das, rest, CAMERA, "clock_offset = -0.2\n")
    assert site.name == "Herzl street"
    assert site.das.channels == (70, 170)
    assert site.das.exclude == (99,)
    assert site.das.scale == 1e-4
    assert site.ground.depth == (1.2, 0.2)
    assert site.camera is not None
    assert site.camera.start == datetime.datetime(2025, 8, 11, 6, tzinfo=datetime.UTC)
    assert (site.camera.clock_offset, site.camera.detector) == (-0.2, "nanodet")


def test_detector_by_name_or_file(folder):
    named = site_of(folder, FRAME, DAS, CAMERA, 'detector = "street"\n').camera
    (folder / "yolo.onnx").touch()
    own = site_of(folder, FRAME, DAS, CAMERA, 'detector = "yolo.onnx"\n').camera
    assert named is not None
    assert own is not None
    assert (named.detector, own.detector) == ("street", folder / "yolo.onnx")
    assert tuple(BUILT_IN) == DETECTORS, "the names that `track` knows, the default first"
    with pytest.raises(InputError, match=r"camera\.detector.*give nanodet, street or an \.onnx file"):
        site_of(folder, FRAME, DAS, CAMERA, "detector = 3\n")


def test_a_file_that_two_patterns_match_counts_once(folder):
    site = site_of(folder, FRAME, f'[das]\nfiles = ["das/a.h5", "das/?.h5", "{folder}/das/b.h5"]\n', TRACKS)
    assert site.das.files == [folder / "das/a.h5", folder / "das/b.h5"]


@pytest.mark.parametrize(
    ("sections", "says"),
    [
        ([FRAME, DAS, "gauge_lenght = 10\n", TRACKS], "unknown key gauge_lenght in [das]; did you mean gauge_length?"),
        ([FRAME, DAS, TRACKS, "[grund]\n"], "unknown key grund at the top; did you mean ground?"),
        ([FRAME, DAS, "colour = 1\n", TRACKS], "unknown key colour in [das]; known: files, gauge_length"),
        ([FRAME, DAS], "neither [camera] nor [trajectories]; give one of them"),
        (['name = "a\\nb"\n', FRAME, DAS, TRACKS], "name: 'a?b'; give at most 200 characters in one line"),
        ([FRAME, TRACKS], "no das; add it"),
        ([DAS, TRACKS], "no frame; add it"),
        (["[frame]\norigin = [32.1, 34.8]\n", DAS, TRACKS], "no frame.x_azimuth; add it"),
        ([FRAME.replace("32.113", "132.1"), DAS, TRACKS], "frame.origin.0: input should be less than or equal to 90"),
        ([FRAME.replace("34.804", '"east"'), DAS, TRACKS], "frame.origin.1: input should be a valid number"),
        ([FRAME, DAS.replace("*.h5", "*.tdms"), TRACKS], "das.files: no file matches 'das/*.tdms'"),
        ([FRAME, DAS.replace("das/*.h5", "/**"), TRACKS], "das.files: '/**' searches outside the site file's folder"),
        ([FRAME, DAS.replace("das/*.h5", "/**/*.h5"), TRACKS], "** goes below it only"),
        ([FRAME, DAS.replace("das/*.h5", "das/../../**/*.h5"), TRACKS], "** goes below it only"),
        ([FRAME, "[das]\nfiles = []\n", TRACKS], "das.files: give a list"),
        ([FRAME, "[das]\nfiles = [3]\n", TRACKS], "das.files: give a list"),
        ([FRAME, DAS, "gauge_length = 0\n", TRACKS], "das.gauge_length: input should be greater than 0"),
        ([FRAME, DAS, "gauge_length = inf\n", TRACKS], "das.gauge_length: input should be a finite number"),
        ([FRAME, DAS, 'quantity = "counts"\n', TRACKS], "das.quantity: input should be 'strain_rate', 'strain'"),
        ([FRAME, DAS, "channels = [90, 80]\n", TRACKS], "das: channels is [90, 80]; give [first, last]"),
        ([FRAME, DAS, "channels = [90]\n", TRACKS], "das.channels"),
        (
            [FRAME, DAS, TRACKS, "[ground]\npoisson_ratio = 0.5\n"],
            "ground.poisson_ratio: input should be less than 0.5",
        ),
        ([FRAME, DAS, TRACKS, "[ground]\npoisson_ratio = 0\n"], "ground.poisson_ratio: input should be greater than 0"),
        (
            [FRAME, DAS, TRACKS, "[ground]\ndepth = [90, 30]\n"],
            "ground.depth: mean 90 m, sd 30 m; no vehicle is sensed",
        ),
        ([FRAME, DAS, TRACKS, "[ground]\ndepth = [0.9, 300]\n"], "ground.depth: mean 0.9 m, sd 300 m; no vehicle is"),
        ([FRAME, DAS, TRACKS, "[ground]\ndepth = [0.9, 0]\n"], "ground.depth.1: input should be greater than 0"),
        ([FRAME, DAS, CAMERA.replace("+02:00", "")], "camera.start: input should have timezone info"),
        ([FRAME, DAS, CAMERA.replace("street.mp4", "lost.mp4")], "camera.video: no such file 'lost.mp4'"),
        ([FRAME, DAS, TRACKS, '[anchors]\nfile = "das"\n'], "anchors.file: no such file 'das'"),
        ([FRAME, DAS, TRACKS, "gauge_length 10\n"], "invalid TOML"),
        (["das = 3\n", FRAME, TRACKS], "das: input should be a valid"),
    ],
)
def test_bad_sites_are_one_clear_line(folder, sections, says):
    with pytest.raises(InputError) as caught:
        site_of(folder, *sections)
    assert says in str(caught.value)
    assert str(caught.value).startswith(f"{folder / 'site.toml'}: ")
    assert "\n" not in str(caught.value)


def test_a_byte_order_mark_is_passed_over_and_utf_16_is_named(folder):
    text = FRAME + DAS + TRACKS
    (folder / "site.toml").write_text(text, encoding="utf-8-sig")
    assert read_site(folder / "site.toml") == site_of(folder, text)
    (folder / "site.toml").write_text(text, encoding="utf-16")
    with pytest.raises(InputError, match=r"site\.toml: is in UTF-16; save it as UTF-8$"):
        read_site(folder / "site.toml")


def test_missing_site_is_one_clear_line(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_site(tmp_path / "site.toml")


def test_practice_surveys_read(shared_data):
    sites = [read_site(path) for path in sorted(shared_data.glob("practice/survey-*/site.toml"))]
    assert [site.name for site in sites] == [f"survey-{number:02}" for number in range(1, 15)]
    assert all(site.das.gauge_length == 10.0 and site.anchors for site in sites)
