"""Mesh bodies: ray-traced radar cross-section, scatterer cells and mesh files."""

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
from dechirp.scene.rays import Rays, Surface, trace_bounce_echoes
from dechirp.scene.rcs import scatterer_cross_sections_m2
from dechirp.scene.scene import Scene
from nightly import nightly

WAVELENGTH_M = 0.0039  # 77 GHz
EDGE_M = 0.1  # 26 wavelengths
POLARISATIONS = ("vertical", "horizontal")


def compute_directions(azimuth_deg, elevation_deg=0.0):
    azimuth, elevation = np.radians(np.broadcast_arrays(azimuth_deg, elevation_deg))
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


def build_surface(mesh):
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


def build_sheet(*corners_m):
    return trimesh.Trimesh(np.array(corners_m, dtype=float), [[0, 1, 2], [0, 2, 3]], process=False)


def build_plate(edge_m=EDGE_M):
    """Build a square plate that faces forward."""
    h = edge_m / 2
    return build_sheet((0, -h, -h), (0, h, -h), (0, h, h), (0, -h, h))


def build_dihedral():
    """Build two squares at 90 deg with a vertical seam at the origin, open to the front."""
    w, h = EDGE_M / np.sqrt(2), EDGE_M / 2
    halves = [
        build_sheet((0, 0, -h), (w, side * w, -h), (w, side * w, h), (0, 0, h)) for side in (1, -1)
    ]
    return trimesh.util.concatenate(halves)


def build_trihedral():
    """Build three triangles with their apex at the origin, open to (1, 1, 1)."""
    corners_m = np.vstack([np.zeros(3), EDGE_M * np.eye(3)])
    return trimesh.Trimesh(corners_m, [[0, 1, 2], [0, 2, 3], [0, 3, 1]], process=False)


def compute_rcs_m2(surface, towards, wavelength_m, rays=None):
    """Compute the monostatic RCS in directions (..., 3), from the coherent sum over all tubes."""
    directions = np.asarray(towards)
    sums = [
        sum(part.field_m.sum() for part in trace_bounce_echoes(surface, d, wavelength_m, rays))
        for d in directions.reshape(-1, 3)
    ]
    return abs(np.array(sums)).reshape(directions.shape[:-1]) ** 2


def compute_error_db(rcs_m2, expected_m2):
    return 10 * np.log10(np.asarray(rcs_m2) / np.asarray(expected_m2))


@pytest.mark.parametrize("polarisation", POLARISATIONS)
def test_plate_rcs_matches_aperture_over_main_lobe(polarisation):
    # The first null is at 1.1 deg; the closed form falls by 11 dB up to 0.8 deg.
    angle = np.array([0, 0.2, 0.4, 0.6, 0.8])
    lobe = np.sinc(2 * EDGE_M / WAVELENGTH_M * np.sin(np.radians(angle))) ** 2
    expected_m2 = 4 * np.pi * EDGE_M**4 / WAVELENGTH_M**2 * lobe
    rays = Rays(polarisation=polarisation)

    for directions in (compute_directions(angle), compute_directions(0, angle)):
        rcs_m2 = compute_rcs_m2(build_surface(build_plate()), directions, WAVELENGTH_M, rays)
        assert compute_error_db(rcs_m2, expected_m2) == pytest.approx(0, abs=0.2)


@pytest.mark.parametrize("polarisation", POLARISATIONS)
def test_dihedral_rcs_matches_projected_aperture(polarisation):
    # Across the seam every ray returns; the projected width of both faces is
    # 2 a sin(45 deg - angle).
    angle = np.array([-20, -5, 0, 10, 20])
    aperture_m2 = EDGE_M * 2 * EDGE_M * np.sin(np.radians(45 - abs(angle)))
    expected_m2 = 4 * np.pi * aperture_m2**2 / WAVELENGTH_M**2
    rays = Rays(polarisation=polarisation)
    rcs_m2 = compute_rcs_m2(
        build_surface(build_dihedral()), compute_directions(angle), WAVELENGTH_M, rays
    )
    assert compute_error_db(rcs_m2, expected_m2) == pytest.approx(0, abs=0.3)

    # Along the seam the dihedral behaves like a plate.
    angle = np.array([0.3, 0.6, 0.8])
    lobe = np.sinc(2 * EDGE_M / WAVELENGTH_M * np.sin(np.radians(angle))) ** 2
    rcs_m2 = compute_rcs_m2(
        build_surface(build_dihedral()), compute_directions(0, angle), WAVELENGTH_M, rays
    )
    assert compute_error_db(rcs_m2, expected_m2[2] * lobe) == pytest.approx(0, abs=0.3)


@pytest.mark.parametrize("polarisation", POLARISATIONS)
def test_trihedral_rcs_matches_projected_aperture(polarisation):
    # R. C. Spencer, "Optical theory of the corner reflector", MIT Radiation Laboratory, 1944:
    # projected aperture from the sorted direction cosines; on the axis a^2 / sqrt(3).
    directions = compute_directions([45, 45, 45, 45, 30, 20], [35.2644, 25, 50, 15, 35, 30])
    smallest, middle, largest = np.sort(directions, axis=-1).T
    total = smallest + middle + largest
    inner, outer = total - 2 / total, 4 * smallest * middle / total
    aperture_m2 = EDGE_M**2 * np.where(smallest + middle >= largest, inner, outer)
    expected_m2 = 4 * np.pi * aperture_m2**2 / WAVELENGTH_M**2
    assert expected_m2[0] == pytest.approx(4 * np.pi * EDGE_M**4 / 3 / WAVELENGTH_M**2)

    rays = Rays(polarisation=polarisation)
    rcs_m2 = compute_rcs_m2(build_surface(build_trihedral()), directions, WAVELENGTH_M, rays)
    assert compute_error_db(rcs_m2, expected_m2) == pytest.approx(0, abs=0.3)


def test_sphere_rcs_matches_disc_from_all_sides():
    # Facets of half a wavelength deviate at most 0.005 wavelengths from the sphere.
    ball = build_surface(trimesh.creation.icosphere(subdivisions=6, radius=EDGE_M))
    directions = [(1, 0, 0), (1, 0.3, 0.2), (0.2, 0.1, 1), (0, 0, -1)]
    rcs_m2 = compute_rcs_m2(ball, directions, WAVELENGTH_M)
    assert compute_error_db(rcs_m2, np.pi * EDGE_M**2) == pytest.approx(0, abs=0.7)


def test_flat_surface_allows_ray_spacing_of_two_wavelengths():
    # Point sources at ray centres would give grating lobes: at 14.5 deg for a spacing of two
    # wavelengths, as strong as the main lobe. Linear phase over each ray tube suppresses them.
    rays = Rays(spacing_m=2 * WAVELENGTH_M)
    straight_m2, tilted_m2, grating_m2 = compute_rcs_m2(
        build_surface(build_plate()), compute_directions([0, 0.6, 14.4775]), WAVELENGTH_M, rays
    )
    peak_m2 = 4 * np.pi * EDGE_M**4 / WAVELENGTH_M**2
    lobe = np.sinc(2 * EDGE_M / WAVELENGTH_M * np.sin(np.radians(0.6))) ** 2
    assert compute_error_db(straight_m2, peak_m2) == pytest.approx(0, abs=0.3)
    assert compute_error_db(tilted_m2, peak_m2 * lobe) == pytest.approx(0, abs=0.3)
    assert compute_error_db(grating_m2, peak_m2) < -25


def test_dihedral_rotated_by_45_degrees_is_cross_polarised():
    tilted_mesh = build_dihedral()
    tilted_mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4, (1, 0, 0)))
    upright_m2 = compute_rcs_m2(
        build_surface(build_dihedral()), compute_directions(0), WAVELENGTH_M
    )
    for polarisation in POLARISATIONS:
        rays = Rays(polarisation=polarisation)
        assert (
            compute_rcs_m2(build_surface(tilted_mesh), compute_directions(0), WAVELENGTH_M, rays)
            < 1e-3 * upright_m2
        )


def test_double_bounce_changes_sign_along_seam_and_not_across():
    # A plate of the same aperture stands next to the dihedral, at the depth of its seam.
    half_m = np.sqrt(np.sqrt(2)) * EDGE_M / 2
    offset_plate = build_plate(2 * half_m)
    offset_plate.apply_translation((0, 0.3, 0))
    combined_surface = build_surface(trimesh.util.concatenate([build_dihedral(), offset_plate]))
    dihedral_m2 = compute_rcs_m2(build_surface(build_dihedral()), (1, 0, 0), WAVELENGTH_M)
    along_seam_m2, across_seam_m2 = (
        compute_rcs_m2(combined_surface, (1, 0, 0), WAVELENGTH_M, Rays(polarisation=name))
        for name in POLARISATIONS
    )
    assert along_seam_m2 < 0.01 * dihedral_m2
    assert compute_error_db(across_seam_m2, 4 * dihedral_m2) == pytest.approx(0, abs=0.3)


def test_screened_return_ray_adds_no_echo():
    # A slanted screen in front of one face blocks rays after their second reflection.
    w, h = 2 * EDGE_M, EDGE_M
    screen = build_sheet((w, 0, -h), (0.75 * w, w, -h), (0.75 * w, w, h), (w, 0, h))
    screened_surface = build_surface(trimesh.util.concatenate([build_dihedral(), screen]))
    open_m2 = compute_rcs_m2(build_surface(build_dihedral()), (1, 0, 0), WAVELENGTH_M)
    assert compute_rcs_m2(screened_surface, (1, 0, 0), WAVELENGTH_M) < 0.01 * open_m2


def test_corner_needs_one_bounce_per_face():
    for mesh, direction, n_faces in (
        (build_dihedral(), (1, 0, 0), 2),
        (build_trihedral(), (1, 1, 1), 3),
    ):
        rcs_m2 = [
            compute_rcs_m2(build_surface(mesh), direction, WAVELENGTH_M, Rays(n_bounces=n))
            for n in range(1, n_faces + 2)
        ]
        assert max(rcs_m2[: n_faces - 1]) < 0.1 * rcs_m2[n_faces - 1]
        assert rcs_m2[n_faces] == pytest.approx(rcs_m2[n_faces - 1])


def test_ray_direction_without_length_is_rejected():
    small_surface = build_surface(build_plate(0.02))
    with pytest.raises(dc.InvalidSetting, match="positive length"):
        compute_rcs_m2(small_surface, (0, 0, 0), WAVELENGTH_M)


@pytest.fixture
def save_mesh(tmp_path):
    def save(mesh, name="body.stl"):
        path = tmp_path / name
        mesh.export(path)
        return str(path)

    return save


def build_balls(positions_m, radii_m, subdivisions):
    spheres = [trimesh.creation.icosphere(subdivisions=subdivisions, radius=r) for r in radii_m]
    for ball, position_m in zip(spheres, positions_m, strict=True):
        ball.apply_translation(position_m)
    return trimesh.util.concatenate(spheres)


def test_each_ball_becomes_scatterer_with_its_rcs(save_mesh):
    # One ball per cell. One bounce: paths between balls would change the weakest one by 1 dB.
    radii_m = np.array([0.04, 0.06, 0.05])
    positions_m = np.array([(-0.04, -0.3, 0), (-0.06, 0, 0), (-0.05, 0.3, 0)])
    path = save_mesh(build_balls(positions_m, radii_m, subdivisions=5))
    body = Mesh(path=path, cell_size_m=0.25, rays=Rays(n_bounces=1))
    rcs_m2 = body.cross_sections_towards_m2(np.array([(30.0, 0, 0)]), WAVELENGTH_M)[0]

    offsets_m = body.scatterer_offsets_m(np.zeros(1))[0]
    order = np.argsort(offsets_m[:, 1])
    assert offsets_m[order] == pytest.approx(positions_m, abs=1e-3)
    assert compute_error_db(rcs_m2[order], np.pi * radii_m**2) == pytest.approx(0, abs=0.7)


@nightly
def test_sum_over_cells_is_phase_averaged_rcs(save_mesh):
    # Phases between 12 balls change by many cycles from aspect to aspect: the coherent RCS is
    # exponentially distributed, its mean over 20 aspects has a standard error of 1 dB. Two of them.
    rng = np.random.default_rng(5)
    positions_m = np.stack([np.arange(12) % 4, np.arange(12) // 4, np.zeros(12)], axis=1)
    positions_m = 0.2 * positions_m + rng.uniform(-0.02, 0.02, (12, 3))
    mesh = build_balls(positions_m, np.full(12, 0.03), subdivisions=4)
    body = Mesh(path=save_mesh(mesh), cell_size_m=0.1)
    directions = compute_directions(rng.uniform(-180, 180, 20), rng.uniform(40, 80, 20))
    coherent_m2 = compute_rcs_m2(build_surface(mesh), directions, WAVELENGTH_M)
    incoherent_m2 = body.cross_sections_towards_m2(30 * directions, WAVELENGTH_M).sum(axis=1)
    assert compute_error_db(incoherent_m2.mean(), coherent_m2.mean()) == pytest.approx(0, abs=2)
    # The sum over cells does not depend on those phases, so it varies less.
    assert incoherent_m2.std() / incoherent_m2.mean() < 0.5 * coherent_m2.std() / coherent_m2.mean()


@pytest.mark.filterwarnings("ignore:.*is open")
@pytest.mark.parametrize("build_corner", [build_dihedral, build_trihedral])
def test_corner_echo_comes_from_its_apex(save_mesh, build_corner):
    body = Mesh(path=save_mesh(build_corner()), cell_size_m=0.02)
    radar_m = np.array([(10.0, 10, 10) if build_corner is build_trihedral else (20, 0, 0)])
    rcs_m2 = body.cross_sections_towards_m2(radar_m, WAVELENGTH_M)[0]
    offsets_m = body.scatterer_offsets_m(np.zeros(1))[0, rcs_m2 > 0.01 * rcs_m2.max()]
    # Depth along the line of sight: within one cell of the seam or apex.
    depth_m = offsets_m @ radar_m[0] / np.linalg.norm(radar_m)
    assert abs(depth_m).max() < 0.02


@pytest.mark.filterwarnings("ignore:.*is open")
def test_plate_hides_ball_behind_it(save_mesh):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.03)
    ball.apply_translation((-0.5, 0, 0))
    body = Mesh(path=save_mesh(trimesh.util.concatenate([build_plate(), ball])), cell_size_m=0.1)
    front_m2, back_m2 = body.cross_sections_towards_m2(
        np.array([(20.0, 0, 0), (-20.0, 0, 0)]), WAVELENGTH_M
    )
    is_ball = body.scatterer_offsets_m(np.zeros(1))[0, :, 0] < -0.3
    assert front_m2[is_ball].max() == 0 < back_m2[is_ball].max()
    assert front_m2[~is_ball].max() > 0


def test_traced_rays_never_exceed_predicted_number(save_mesh, monkeypatch):
    body = Mesh(
        path=save_mesh(trimesh.creation.box((0.8, 0.4, 0.3))),
        rays=Rays(spacing_m=0.02, n_bounces=1),
    )
    ray_counts, find_first_hits = [], Surface.find_first_hit_face_indices

    def count_rays(traced_surface, origins_m, directions):
        ray_counts.append(len(origins_m))
        return find_first_hits(traced_surface, origins_m, directions)

    monkeypatch.setattr(Surface, "find_first_hit_face_indices", count_rays)
    sides = 20 * compute_directions(np.arange(0, 360, 20), np.linspace(-80, 80, 18))
    body.cross_sections_towards_m2(sides, WAVELENGTH_M)
    assert len(ray_counts) == len(sides)  # one pass per side
    assert 0.5 < max(ray_counts) / body.max_rays_per_direction(WAVELENGTH_M) <= 1


def test_nearby_radar_positions_share_rcs(save_mesh):
    # The echo of a 0.3 m cell changes over lambda / 0.6 m, 6.5 mrad; directions within a
    # twentieth of it share one result.
    body = Mesh(path=save_mesh(trimesh.creation.box((0.2, 0.2, 0.2))), rays=Rays(spacing_m=0.01))
    angles = np.degrees([0.0, 0.0001, 0.01])
    reference_m2, near_m2, far_m2 = body.cross_sections_towards_m2(
        20 * compute_directions(angles), WAVELENGTH_M
    )
    assert (reference_m2 == near_m2).all()
    assert (reference_m2 != far_m2).any()


@pytest.mark.filterwarnings("ignore:.*is open")
def test_plate_of_cell_size_keeps_main_lobe(save_mesh):
    body = Mesh(path=save_mesh(build_plate()), cell_size_m=0.101, rays=Rays(spacing_m=0.003))
    # The first null is at 1.1 deg.
    angle = np.linspace(0, 0.75, 16)
    lobe = np.sinc(2 * EDGE_M / WAVELENGTH_M * np.sin(np.radians(angle))) ** 2
    expected_m2 = 4 * np.pi * EDGE_M**4 / WAVELENGTH_M**2 * lobe
    rcs_m2 = body.cross_sections_towards_m2(1e3 * compute_directions(angle), WAVELENGTH_M).sum(
        axis=1
    )
    assert compute_error_db(rcs_m2, expected_m2) == pytest.approx(0, abs=1)


def test_pickled_body_keeps_computed_rcs(save_mesh):
    body = Mesh(path=save_mesh(trimesh.creation.box((0.2, 0.2, 0.2))), rays=Rays(spacing_m=0.01))
    ahead_m, aside_m = np.array([(20.0, 0, 0)]), np.array([(20.0, 1, 0)])
    rcs_m2 = body.cross_sections_towards_m2(ahead_m, WAVELENGTH_M)
    unpickled_body = pickle.loads(pickle.dumps(body))

    assert unpickled_body == body
    assert (unpickled_body.cross_sections_towards_m2(ahead_m, WAVELENGTH_M) == rcs_m2).all()
    aside_rcs_m2 = body.cross_sections_towards_m2(aside_m, WAVELENGTH_M)
    assert unpickled_body.cross_sections_towards_m2(aside_m, WAVELENGTH_M) == pytest.approx(
        aside_rcs_m2
    )


@pytest.mark.parametrize("name", ["box.stl", "box.obj", "box.ply", "BOX.STL"])
def test_mesh_formats_give_same_box_in_configured_unit(tmp_path, save_mesh, name):
    box_mm = trimesh.creation.box((400, 200, 100))
    path = save_mesh(box_mm, name.lower())
    path = str(Path(path).rename(tmp_path / name))
    mesh = read_mesh(path, "mm")

    assert (mesh.is_closed, mesh.n_degenerate) == (True, 0)
    assert mesh.surface.corners_m.shape == (12, 3, 3)
    assert np.ptp(mesh.surface.corners_m, axis=(0, 1)) == pytest.approx([0.4, 0.2, 0.1])
    body = Mesh(path=path, unit="mm", cell_size_m=1.0)
    # One cell in the centre.
    assert body.scatterer_offsets_m(np.zeros(2)) == pytest.approx(0, abs=1e-9)
    assert body.n_scatterers() == 1


def test_obj_loads_without_its_material_library(tmp_path):
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    faces = "f 1 3 2\nusemtl b\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    path = tmp_path / "corner.obj"
    path.write_text(f"mtllib ../../elsewhere.mtl\no one\n{corners}usemtl a\n{faces}")
    mesh = read_mesh(str(path))
    assert mesh.is_closed
    assert len(mesh.surface.faces) == 4


def test_warns_of_open_mesh_wrong_unit_and_zero_area_faces(save_mesh, tmp_path, radar):
    (finding,) = Mesh(path=save_mesh(build_plate(2.0))).unusual_property_findings("body")
    assert "body.stl is open" in finding.value
    box = trimesh.creation.box((2, 1, 1))
    (finding,) = Mesh(
        path=save_mesh(box, "box.stl"), unit="mm", cell_size_m=0.001
    ).unusual_property_findings("body")
    assert finding.setting == "body.unit" and "box.stl is 2.45 mm in size" in finding.value
    house = trimesh.creation.box((40, 1, 1))
    (finding,) = Mesh(
        path=save_mesh(house, "house.stl"), cell_size_m=1.0
    ).unusual_property_findings("body")
    assert finding.setting == "body.unit" and "house.stl is 40.02 m in size" in finding.value
    mesh_with_zero_area_face = trimesh.Trimesh(
        box.vertices, np.vstack([box.faces, [[0, 0, 1]]]), process=False
    )
    body = Mesh(
        path=save_mesh(mesh_with_zero_area_face, "box.ply"),
        cell_size_m=1.0,
        rays=Rays(spacing_m=0.05),
    )
    # The mesh is closed nevertheless; the warning on simulation contains the target name.
    scene = dc.Scene(targets=[dc.Target(name="crate", position_m=(20, 0, 0), body=body)])
    with pytest.warns(dc.PhysicsWarning, match=r"crate\.body\.path: 1 triangles of .* no area"):
        dc.simulate(scene, radar, impairments=())


HEADER = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
)


@pytest.mark.parametrize(
    ("name", "content", "message"),
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
def test_rejects_invalid_mesh_file_with_its_path(tmp_path, name, content, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(dc.InvalidSetting) as error:
        Mesh(path=str(path))
    assert message in str(error.value)
    assert str(path) in str(error.value)


@pytest.mark.parametrize("kind", ["stl", "obj", "ply"])
@pytest.mark.filterwarnings("ignore::dechirp.core.findings.PhysicsWarning")
def test_damaged_file_is_loaded_or_rejected(tmp_path, save_mesh, kind):
    path = Path(save_mesh(trimesh.creation.box((1, 1, 1)), f"box.{kind}"))
    content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    rng = np.random.default_rng(8)
    for _ in range(40):
        damaged = content.copy()
        damaged[rng.integers(len(content), size=3)] = rng.integers(256, size=3)
        path.write_bytes(damaged[: rng.integers(1, 2 * len(content))].tobytes())
        try:
            Mesh(path=str(path), cell_size_m=1.0)
        except dc.InvalidSetting as error:
            assert str(path) in str(error) or "cell_size" in str(error)


def test_rejects_invalid_settings(save_mesh):
    path = save_mesh(trimesh.creation.box((1, 1, 1)))
    cases = [
        ({"unit": "furlong"}, "Mesh.unit"),
        ({"cell_size_m": 0.0}, "Mesh.cell_size_m"),
        ({"cell_size_m": 0.001}, "1e\\+09 of which"),
        ({"path": 3}, "Mesh.path"),
        ({"rays": 3}, "Mesh.rays"),
    ]
    for settings, message in cases:
        with pytest.raises(dc.InvalidSetting, match=message):
            Mesh(**{"path": path, **settings})
    for settings in ({"spacing_m": -1.0}, {"n_bounces": 0}, {"polarisation": "circular"}):
        with pytest.raises(dc.InvalidSetting, match=f"Rays.{next(iter(settings))}"):
            Rays(**settings)


def test_rejects_scene_with_too_many_rays(save_mesh):
    body = Mesh(path=save_mesh(trimesh.creation.box((60, 60, 60))), cell_size_m=5.0)
    with pytest.raises(dc.InvalidSetting, match=r"1\.95 mm, .* 1.*e\+09 rays .*body"):
        body.cross_sections_towards_m2(np.array([(100.0, 0, 0)]), WAVELENGTH_M)
    scene = Scene(targets=[dc.Target(name="hall", position_m=(100, 0, 0), body=body)])
    with pytest.raises(dc.InvalidSetting, match=r"^scene\.targets\.hall\.body\.rays\.spacing: "):
        scatterer_cross_sections_m2(scene, 0.0, WAVELENGTH_M)


@pytest.mark.parametrize("missing", ["trimesh", "embreex"])
def test_missing_package_error_gives_install_command(monkeypatch, save_mesh, missing):
    path = save_mesh(trimesh.creation.box((1, 1, 1)))
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


def test_mesh_path_is_relative_to_settings_file(tmp_path, save_mesh):
    save_mesh(trimesh.creation.box((200, 100, 100)), "crate.stl")
    scene = parse_settings(SETTINGS.replace("UNIT", "mm"), Scene, base_folder=tmp_path)
    # The rear face, 0.1 m square and one cell, faces the radar.
    expected_m2 = 4 * np.pi * 0.1**4 / WAVELENGTH_M**2
    rcs_m2 = scatterer_cross_sections_m2(scene, 0.0, WAVELENGTH_M)
    assert rcs_m2.shape == (1,)
    assert compute_error_db(rcs_m2, expected_m2) == pytest.approx(0, abs=0.3)


def test_mesh_error_gives_setting_path_and_line(tmp_path, save_mesh):
    save_mesh(trimesh.creation.box((200, 100, 100)), "crate.stl")
    with pytest.raises(InvalidFile, match=r"targets\.crate\.body\.unit: m, with which") as error:
        parse_settings(
            SETTINGS.replace("UNIT", "m"), Scene, base_folder=tmp_path, file="scene.yaml"
        )
    (mistake,) = error.value.mistakes
    assert mistake.line == 5
