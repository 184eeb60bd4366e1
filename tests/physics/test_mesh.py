"""Meshes: what surfaces send back, and the files that they come from."""

import pickle
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import dechirp as dc
from dechirp.config.loading import parse_settings
from dechirp.core.errors import InvalidFile
from dechirp.scene.bodies.mesh import Mesh
from dechirp.scene.mesh_files import read_mesh
from dechirp.scene.rays import Rays, Surface, compute_rcs_m2
from dechirp.scene.rcs import scatterer_cross_sections_m2
from dechirp.scene.scene import Scene

WAVELENGTH_M = 0.0039  # 77 GHz
EDGE_M = 0.1  # 26 wavelengths
POLARISATIONS = ("vertical", "horizontal")


def towards(azimuth_deg, elevation_deg=0.0):
    azimuth, elevation = np.radians(np.broadcast_arrays(azimuth_deg, elevation_deg))
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


def surface(mesh):
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


def sheet(*corners_m):
    return trimesh.Trimesh(np.array(corners_m, dtype=float), [[0, 1, 2], [0, 2, 3]], process=False)


def plate(edge_m=EDGE_M):
    """Square, facing forward."""
    h = edge_m / 2
    return sheet((0, -h, -h), (0, h, -h), (0, h, h), (0, -h, h))


def dihedral():
    """Two squares at 90 deg, the seam upright at the origin, open to the front."""
    w, h = EDGE_M / np.sqrt(2), EDGE_M / 2
    halves = [sheet((0, 0, -h), (w, side * w, -h), (w, side * w, h), (0, 0, h)) for side in (1, -1)]
    return trimesh.util.concatenate(halves)


def trihedral():
    """Three triangles, the apex at the origin, open to (1, 1, 1)."""
    corners_m = np.vstack([np.zeros(3), EDGE_M * np.eye(3)])
    return trimesh.Trimesh(corners_m, [[0, 1, 2], [0, 2, 3], [0, 3, 1]], process=False)


def off_db(found_m2, expected_m2):
    return 10 * np.log10(np.asarray(found_m2) / np.asarray(expected_m2))


@pytest.mark.parametrize("polarisation", POLARISATIONS)
def test_a_plate_reflects_as_its_aperture_over_the_main_lobe(polarisation):
    # The first null is at 1.1 deg; the closed form falls by 11 dB up to 0.8 deg.
    angle = np.array([0, 0.2, 0.4, 0.6, 0.8])
    lobe = np.sinc(2 * EDGE_M / WAVELENGTH_M * np.sin(np.radians(angle))) ** 2
    expected_m2 = 4 * np.pi * EDGE_M**4 / WAVELENGTH_M**2 * lobe
    rays = Rays(polarisation=polarisation)

    for directions in (towards(angle), towards(0, angle)):
        found_m2 = compute_rcs_m2(surface(plate()), directions, WAVELENGTH_M, rays)
        assert off_db(found_m2, expected_m2) == pytest.approx(0, abs=0.2)


@pytest.mark.parametrize("polarisation", POLARISATIONS)
def test_a_dihedral_reflects_as_the_aperture_it_shows(polarisation):
    # Across the seam each ray comes back; what both faces show is 2 a sin(45 deg - angle) wide.
    angle = np.array([-20, -5, 0, 10, 20])
    shown_m2 = EDGE_M * 2 * EDGE_M * np.sin(np.radians(45 - abs(angle)))
    expected_m2 = 4 * np.pi * shown_m2**2 / WAVELENGTH_M**2
    rays = Rays(polarisation=polarisation)
    found_m2 = compute_rcs_m2(surface(dihedral()), towards(angle), WAVELENGTH_M, rays)
    assert off_db(found_m2, expected_m2) == pytest.approx(0, abs=0.3)

    # Along the seam it is as a plate.
    angle = np.array([0.3, 0.6, 0.8])
    lobe = np.sinc(2 * EDGE_M / WAVELENGTH_M * np.sin(np.radians(angle))) ** 2
    found_m2 = compute_rcs_m2(surface(dihedral()), towards(0, angle), WAVELENGTH_M, rays)
    assert off_db(found_m2, expected_m2[2] * lobe) == pytest.approx(0, abs=0.3)


@pytest.mark.parametrize("polarisation", POLARISATIONS)
def test_a_trihedral_reflects_as_the_aperture_it_shows(polarisation):
    # R. C. Spencer, "Optical theory of the corner reflector", MIT Radiation Laboratory, 1944:
    # of the direction cosines in ascending order. On the axis a^2 / sqrt(3).
    directions = towards([45, 45, 45, 45, 30, 20], [35.2644, 25, 50, 15, 35, 30])
    least, middle, most = np.sort(directions, axis=-1).T
    total = least + middle + most
    inner, outer = total - 2 / total, 4 * least * middle / total
    shown_m2 = EDGE_M**2 * np.where(least + middle >= most, inner, outer)
    expected_m2 = 4 * np.pi * shown_m2**2 / WAVELENGTH_M**2
    assert expected_m2[0] == pytest.approx(4 * np.pi * EDGE_M**4 / 3 / WAVELENGTH_M**2)

    rays = Rays(polarisation=polarisation)
    found_m2 = compute_rcs_m2(surface(trihedral()), directions, WAVELENGTH_M, rays)
    assert off_db(found_m2, expected_m2) == pytest.approx(0, abs=0.3)


def test_a_sphere_reflects_as_its_disc_from_all_sides():
    # Facets of half a wavelength: they are at most 0.005 wavelengths off the sphere.
    ball = surface(trimesh.creation.icosphere(subdivisions=6, radius=EDGE_M))
    directions = [(1, 0, 0), (1, 0.3, 0.2), (0.2, 0.1, 1), (0, 0, -1)]
    found_m2 = compute_rcs_m2(ball, directions, WAVELENGTH_M)
    assert off_db(found_m2, np.pi * EDGE_M**2) == pytest.approx(0, abs=0.7)


def test_flat_parts_bear_tubes_of_several_wavelengths():
    # A point in the middle of each tube would see the lobes of a grating: of tubes two wavelengths
    # wide at 14.5 deg, as strong as the main lobe. Tubes have linear phase, and see none.
    rays = Rays(spacing_m=2 * WAVELENGTH_M)
    straight_m2, tilted_m2, grating_m2 = compute_rcs_m2(
        surface(plate()), towards([0, 0.6, 14.4775]), WAVELENGTH_M, rays
    )
    most_m2 = 4 * np.pi * EDGE_M**4 / WAVELENGTH_M**2
    lobe = np.sinc(2 * EDGE_M / WAVELENGTH_M * np.sin(np.radians(0.6))) ** 2
    assert off_db(straight_m2, most_m2) == pytest.approx(0, abs=0.3)
    assert off_db(tilted_m2, most_m2 * lobe) == pytest.approx(0, abs=0.3)
    assert off_db(grating_m2, most_m2) < -25


def test_a_dihedral_on_its_side_by_45_degrees_turns_the_polarisation():
    tilted = dihedral()
    tilted.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4, (1, 0, 0)))
    upright_m2 = compute_rcs_m2(surface(dihedral()), towards(0), WAVELENGTH_M)
    for polarisation in POLARISATIONS:
        rays = Rays(polarisation=polarisation)
        assert compute_rcs_m2(surface(tilted), towards(0), WAVELENGTH_M, rays) < 1e-3 * upright_m2


def test_two_bounces_turn_the_sign_along_the_seam_and_keep_it_across():
    # Beside the dihedral, as deep as its seam, a plate of the same aperture.
    half_m = np.sqrt(np.sqrt(2)) * EDGE_M / 2
    beside = plate(2 * half_m)
    beside.apply_translation((0, 0.3, 0))
    both = surface(trimesh.util.concatenate([dihedral(), beside]))
    alone_m2 = compute_rcs_m2(surface(dihedral()), (1, 0, 0), WAVELENGTH_M)
    along_m2, across_m2 = (
        compute_rcs_m2(both, (1, 0, 0), WAVELENGTH_M, Rays(polarisation=name))
        for name in POLARISATIONS
    )
    assert along_m2 < 0.01 * alone_m2
    assert off_db(across_m2, 4 * alone_m2) == pytest.approx(0, abs=0.3)


def test_what_cannot_leave_towards_the_radar_does_not_come_back():
    # A slanted screen before one face: rays to the other go on to that face, and no further.
    w, h = 2 * EDGE_M, EDGE_M
    screen = sheet((w, 0, -h), (0.75 * w, w, -h), (0.75 * w, w, h), (w, 0, h))
    covered = surface(trimesh.util.concatenate([dihedral(), screen]))
    open_m2 = compute_rcs_m2(surface(dihedral()), (1, 0, 0), WAVELENGTH_M)
    assert compute_rcs_m2(covered, (1, 0, 0), WAVELENGTH_M) < 0.01 * open_m2


def test_corners_take_as_many_bounces_as_they_have_faces():
    for mesh, direction, needed in ((dihedral(), (1, 0, 0), 2), (trihedral(), (1, 1, 1), 3)):
        found_m2 = [
            compute_rcs_m2(surface(mesh), direction, WAVELENGTH_M, Rays(n_bounces=n))
            for n in range(1, needed + 2)
        ]
        assert max(found_m2[: needed - 1]) < 0.1 * found_m2[needed - 1]
        assert found_m2[needed] == pytest.approx(found_m2[needed - 1])


def test_one_direction_gives_one_number_and_more_their_shape():
    small = surface(plate(0.02))
    assert compute_rcs_m2(small, (1, 0, 0), WAVELENGTH_M).shape == ()
    assert compute_rcs_m2(small, np.ones((2, 3, 3)), WAVELENGTH_M).shape == (2, 3)
    with pytest.raises(dc.InvalidSetting, match="positive length"):
        compute_rcs_m2(small, (0, 0, 0), WAVELENGTH_M)


@pytest.fixture
def saved(tmp_path):
    def save(mesh, name="body.stl"):
        path = tmp_path / name
        mesh.export(path)
        return str(path)

    return save


def balls(places_m, radii_m, subdivisions):
    made = [trimesh.creation.icosphere(subdivisions=subdivisions, radius=r) for r in radii_m]
    for ball, place_m in zip(made, places_m, strict=True):
        ball.apply_translation(place_m)
    return trimesh.util.concatenate(made)


def test_each_ball_is_a_scatterer_with_its_own_cross_section(saved):
    # Each in a cell. One bounce: what goes from ball to ball and back is 1 dB of the least.
    radii_m = np.array([0.04, 0.06, 0.05])
    places_m = np.array([(-0.04, -0.3, 0), (-0.06, 0, 0), (-0.05, 0.3, 0)])
    path = saved(balls(places_m, radii_m, subdivisions=5))
    body = Mesh(path=path, cell_size_m=0.25, rays=Rays(n_bounces=1))
    found_m2 = body.cross_sections_towards_m2(np.array([(30.0, 0, 0)]), WAVELENGTH_M)[0]

    at_m = body.offsets_m(np.zeros(1))[0]
    order = np.argsort(at_m[:, 1])
    assert at_m[order] == pytest.approx(places_m, abs=1e-3)
    assert off_db(found_m2[order], np.pi * radii_m**2) == pytest.approx(0, abs=0.7)


def test_the_sum_over_cells_is_the_cross_section_averaged_over_phases(saved):
    # Phases between 12 balls change by many turns from aspect to aspect: the whole is
    # exponential, its mean over 20 aspects known to 1 dB. Two standard errors.
    rng = np.random.default_rng(5)
    places_m = np.stack([np.arange(12) % 4, np.arange(12) // 4, np.zeros(12)], axis=1)
    places_m = 0.2 * places_m + rng.uniform(-0.02, 0.02, (12, 3))
    mesh = balls(places_m, np.full(12, 0.03), subdivisions=4)
    body = Mesh(path=saved(mesh), cell_size_m=0.1)
    directions = towards(rng.uniform(-180, 180, 20), rng.uniform(40, 80, 20))
    together_m2 = compute_rcs_m2(surface(mesh), directions, WAVELENGTH_M)
    apart_m2 = body.cross_sections_towards_m2(30 * directions, WAVELENGTH_M).sum(axis=1)
    assert off_db(apart_m2.mean(), together_m2.mean()) == pytest.approx(0, abs=2)
    # Cells keep what does not depend on those phases: it varies less.
    assert apart_m2.std() / apart_m2.mean() < 0.5 * together_m2.std() / together_m2.mean()


@pytest.mark.filterwarnings("ignore:.*is open")
@pytest.mark.parametrize("make", [dihedral, trihedral])
def test_the_return_of_a_corner_comes_from_its_apex(saved, make):
    body = Mesh(path=saved(make()), cell_size_m=0.02)
    radar_m = np.array([(10.0, 10, 10) if make is trihedral else (20, 0, 0)])
    found_m2 = body.cross_sections_towards_m2(radar_m, WAVELENGTH_M)[0]
    at_m = body.offsets_m(np.zeros(1))[0, found_m2 > 0.01 * found_m2.max()]
    # Along the line of sight: within a cell of the seam or of the apex, not of the faces.
    depth_m = at_m @ radar_m[0] / np.linalg.norm(radar_m)
    assert abs(depth_m).max() < 0.02


@pytest.mark.filterwarnings("ignore:.*is open")
def test_what_is_behind_is_hidden(saved):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.03)
    ball.apply_translation((-0.5, 0, 0))
    body = Mesh(path=saved(trimesh.util.concatenate([plate(), ball])), cell_size_m=0.1)
    ahead, behind = body.cross_sections_towards_m2(
        np.array([(20.0, 0, 0), (-20.0, 0, 0)]), WAVELENGTH_M
    )
    is_ball = body.offsets_m(np.zeros(1))[0, :, 0] < -0.3
    assert ahead[is_ball].max() == 0 < behind[is_ball].max()
    assert ahead[~is_ball].max() > 0


def test_from_no_side_more_rays_are_traced_than_are_told(saved, monkeypatch):
    body = Mesh(
        path=saved(trimesh.creation.box((0.8, 0.4, 0.3))),
        rays=Rays(spacing_m=0.02, n_bounces=1),
    )
    traced, first_hit = [], Surface.find_first_hits

    def counted(of, origins_m, directions):
        traced.append(len(origins_m))
        return first_hit(of, origins_m, directions)

    monkeypatch.setattr(Surface, "find_first_hits", counted)
    sides = 20 * towards(np.arange(0, 360, 20), np.linspace(-80, 80, 18))
    body.cross_sections_towards_m2(sides, WAVELENGTH_M)
    assert len(traced) == len(sides)  # one pass each
    assert 0.5 < max(traced) / body.n_rays(WAVELENGTH_M) <= 1


def test_places_near_each_other_see_the_same(saved):
    # A cell of 0.3 m changes over lambda / 0.6 m, 6.5 mrad; a twentieth of it is taken as one.
    body = Mesh(path=saved(trimesh.creation.box((0.2, 0.2, 0.2))), rays=Rays(spacing_m=0.01))
    angles = np.degrees([0.0, 0.0001, 0.01])
    here, near, off = body.cross_sections_towards_m2(20 * towards(angles), WAVELENGTH_M)
    assert (here == near).all()
    assert (here != off).any()


@pytest.mark.filterwarnings("ignore:.*is open")
def test_a_plate_as_large_as_a_cell_keeps_its_main_lobe(saved):
    body = Mesh(path=saved(plate()), cell_size_m=0.101, rays=Rays(spacing_m=0.003))
    # The first null is at 1.1 deg.
    angle = np.linspace(0, 0.75, 16)
    lobe = np.sinc(2 * EDGE_M / WAVELENGTH_M * np.sin(np.radians(angle))) ** 2
    expected_m2 = 4 * np.pi * EDGE_M**4 / WAVELENGTH_M**2 * lobe
    found_m2 = body.cross_sections_towards_m2(1e3 * towards(angle), WAVELENGTH_M).sum(axis=1)
    assert off_db(found_m2, expected_m2) == pytest.approx(0, abs=1)


def test_a_body_goes_to_another_process_with_what_it_knows(saved):
    body = Mesh(path=saved(trimesh.creation.box((0.2, 0.2, 0.2))), rays=Rays(spacing_m=0.01))
    ahead_m, aside_m = np.array([(20.0, 0, 0)]), np.array([(20.0, 1, 0)])
    found_m2 = body.cross_sections_towards_m2(ahead_m, WAVELENGTH_M)
    sent = pickle.loads(pickle.dumps(body))

    assert sent == body
    assert (sent.cross_sections_towards_m2(ahead_m, WAVELENGTH_M) == found_m2).all()
    again_m2 = body.cross_sections_towards_m2(aside_m, WAVELENGTH_M)
    assert sent.cross_sections_towards_m2(aside_m, WAVELENGTH_M) == pytest.approx(again_m2)


@pytest.mark.parametrize("name", ["box.stl", "box.obj", "box.ply", "BOX.STL"])
def test_the_formats_hold_the_same_in_the_unit_that_is_given(tmp_path, saved, name):
    box_mm = trimesh.creation.box((400, 200, 100))
    path = saved(box_mm, name.lower())
    path = str(Path(path).rename(tmp_path / name))
    found = read_mesh(path, "mm")

    assert (found.is_closed, found.n_degenerate) == (True, 0)
    assert found.surface.corners_m.shape == (12, 3, 3)
    assert np.ptp(found.surface.corners_m, axis=(0, 1)) == pytest.approx([0.4, 0.2, 0.1])
    body = Mesh(path=path, unit="mm", cell_size_m=1.0)
    assert body.offsets_m(np.zeros(2)) == pytest.approx(0, abs=1e-9)  # one cell, in the middle
    assert body.n_scatterers() == 1


def test_an_obj_is_read_without_what_it_names(tmp_path):
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    faces = "f 1 3 2\nusemtl b\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    path = tmp_path / "corner.obj"
    path.write_text(f"mtllib ../../elsewhere.mtl\no one\n{corners}usemtl a\n{faces}")
    found = read_mesh(str(path))
    assert found.is_closed
    assert len(found.surface.faces) == 4


def test_an_open_mesh_and_faces_without_area_are_warned_of(saved, tmp_path, radar):
    (finding,) = Mesh(path=saved(plate(2.0))).findings("body")
    assert "body.stl is open" in finding.value
    box = trimesh.creation.box((2, 1, 1))
    (finding,) = Mesh(path=saved(box, "box.stl"), unit="mm", cell_size_m=0.001).findings("body")
    assert finding.setting == "body.unit" and "box.stl is 2.45 mm in size" in finding.value
    house = trimesh.creation.box((40, 1, 1))
    (finding,) = Mesh(path=saved(house, "house.stl"), cell_size_m=1.0).findings("body")
    assert finding.setting == "body.unit" and "house.stl is 40.02 m in size" in finding.value
    doubled = trimesh.Trimesh(box.vertices, np.vstack([box.faces, [[0, 0, 1]]]), process=False)
    body = Mesh(path=saved(doubled, "box.ply"), cell_size_m=1.0, rays=Rays(spacing_m=0.05))
    # It is closed nevertheless; simulating says so, under the name of the target.
    scene = dc.Scene(targets=[dc.Target(name="crate", position_m=(20, 0, 0), body=body)])
    with pytest.warns(dc.PhysicsWarning, match=r"crate\.body\.path: 1 triangles of .* no area"):
        dc.simulate(scene, radar, impairments=())


HEADER = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("none.stl", None, "does not exist"),
        ("car.step", b"ISO-10303-21;", "STL, OBJ or PLY"),
        ("empty.stl", b"", "empty"),
        ("text.obj", b"\xff\xfe hello", "empty"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\n", "export the mesh again"),
        ("cut.ply", HEADER.encode() + b"0 0 0\n1 0", "cannot be read as PLY"),
        ("beyond.ply", HEADER.encode() + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "beyond its 3"),
        ("beyond.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "cannot be read as OBJ"),
        ("nan.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "non-finite"),
        ("huge.obj", b"v 0 0 -1e308\nv 1 0 1e308\nv 0 1 0\nf 1 2 3\n", "non-finite"),
        ("line.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no area"),
        ("car.obj", b"v 0 0 0\nv 4500 0 0\nv 0 1800 0\nf 1 2 3\n", "unit: mm: it would be 4.5 m"),
    ],
)
def test_a_file_that_is_no_mesh_is_refused_by_name(tmp_path, name, content, says):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(dc.InvalidSetting) as error:
        Mesh(path=str(path))
    assert says in str(error.value)
    assert str(path) in str(error.value)


@pytest.mark.parametrize("kind", ["stl", "obj", "ply"])
@pytest.mark.filterwarnings("ignore::dechirp.core.findings.PhysicsWarning")
def test_a_damaged_file_is_read_or_refused_and_nothing_else(tmp_path, saved, kind):
    path = Path(saved(trimesh.creation.box((1, 1, 1)), f"box.{kind}"))
    whole = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    rng = np.random.default_rng(8)
    for _ in range(40):
        damaged = whole.copy()
        damaged[rng.integers(len(whole), size=3)] = rng.integers(256, size=3)
        path.write_bytes(damaged[: rng.integers(1, 2 * len(whole))].tobytes())
        try:
            Mesh(path=str(path), cell_size_m=1.0)
        except dc.InvalidSetting as error:
            assert str(path) in str(error) or "cell_size" in str(error)


def test_settings_that_cannot_work_are_refused(saved):
    path = saved(trimesh.creation.box((1, 1, 1)))
    wrong = [
        ({"unit": "furlong"}, "Mesh.unit"),
        ({"cell_size_m": 0.0}, "Mesh.cell_size_m"),
        ({"cell_size_m": 0.001}, "1e\\+09 of which"),
        ({"path": 3}, "Mesh.path"),
        ({"rays": 3}, "Mesh.rays"),
    ]
    for given, says in wrong:
        with pytest.raises(dc.InvalidSetting, match=says):
            Mesh(**{"path": path, **given})
    for given in ({"spacing_m": -1.0}, {"n_bounces": 0}, {"polarisation": "circular"}):
        with pytest.raises(dc.InvalidSetting, match=f"Rays.{next(iter(given))}"):
            Rays(**given)


def test_a_scene_that_takes_too_many_rays_is_refused_with_their_number(saved):
    body = Mesh(path=saved(trimesh.creation.box((60, 60, 60))), cell_size_m=5.0)
    with pytest.raises(dc.InvalidSetting, match=r"1\.95 mm, .* 1.*e\+09 rays .*body"):
        body.cross_sections_towards_m2(np.array([(100.0, 0, 0)]), WAVELENGTH_M)
    scene = Scene(targets=[dc.Target(name="hall", position_m=(100, 0, 0), body=body)])
    with pytest.raises(dc.InvalidSetting, match=r"^scene\.targets\.hall\.body\.rays\.spacing: "):
        scatterer_cross_sections_m2(scene, 0.0, WAVELENGTH_M)


@pytest.mark.parametrize("missing", ["trimesh", "embreex"])
def test_without_the_extra_it_says_what_to_install(monkeypatch, saved, missing):
    path = saved(trimesh.creation.box((1, 1, 1)))
    monkeypatch.delattr(trimesh.ray, "ray_pyembree", raising=False)
    monkeypatch.delitem(sys.modules, "trimesh.ray.ray_pyembree", raising=False)
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(dc.InvalidSetting, match=rf"{missing} is not .*pip install 'dechirp\[mesh"):
        Mesh(path=path)


SETTINGS = """
targets:
  - name: crate
    position: [20 m, 0 m, 0 m]
    body: {kind: mesh, path: crate.stl, unit: UNIT, cell_size: 1 m, rays: {spacing: 2 mm}}
"""


def test_a_settings_file_names_a_mesh_beside_it(tmp_path, saved):
    saved(trimesh.creation.box((200, 100, 100)), "crate.stl")
    scene = parse_settings(SETTINGS.replace("UNIT", "mm"), Scene, base=tmp_path)
    # Its back, 0.1 m square and one cell, faces the radar.
    expected_m2 = 4 * np.pi * 0.1**4 / WAVELENGTH_M**2
    found_m2 = scatterer_cross_sections_m2(scene, 0.0, WAVELENGTH_M)
    assert found_m2.shape == (1,)
    assert off_db(found_m2, expected_m2) == pytest.approx(0, abs=0.3)


def test_a_mistake_in_a_mesh_is_told_by_the_path_of_its_target(tmp_path, saved):
    saved(trimesh.creation.box((200, 100, 100)), "crate.stl")
    with pytest.raises(InvalidFile, match=r"targets\.crate\.body\.unit: m, with which") as error:
        parse_settings(SETTINGS.replace("UNIT", "m"), Scene, base=tmp_path, file="scene.yaml")
    (mistake,) = error.value.mistakes
    assert mistake.line == 5
