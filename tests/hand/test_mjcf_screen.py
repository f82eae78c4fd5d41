"""An MJCF that asks for what no hand needs is refused before MuJoCo reads it."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest

from twin_daemon.errors import BadInput
from twin_daemon.hand.mjcf import compile_model
from twin_daemon.hand.mjcf_screen import screen_mjcf

BODY = '<worldbody><body><joint name="j"/><geom size="0.1" mass="1"/></body></worldbody>'
BOMB = '<!DOCTYPE m [<!ENTITY a "x"><!ENTITY b "&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;">]>'


@pytest.fixture
def model(tmp_path: Path):
    folder = tmp_path / "model"
    folder.mkdir()

    def write(inner: str, before: str = "", name: str = "it.xml") -> Path:
        path = folder / name
        path.write_text(f"{before}<mujoco>{inner}</mujoco>")
        return path

    return write


def test_a_plain_model_with_an_include_and_a_file_beside_it_is_read(model) -> None:
    model(BODY, name="hand.xml")
    assert compile_model(model('<include file="hand.xml"/>')).njnt == 1


@pytest.mark.parametrize(
    ("inner", "before", "said"),
    [
        (BODY, BOMB, "entities"),
        ('<include file="../secret.xml"/>', "", "outside its folder"),
        ('<include file="/etc/passwd"/>', "", "outside its folder"),
        ('<asset><mesh file="../../mesh.stl"/></asset>', "", "outside its folder"),
        ('<compiler meshdir="../elsewhere"/><asset><mesh file="a.stl"/></asset>', "", "outside its folder"),
        ('<include file="nowhere.xml"/>', "", "not there"),
        ("<worldbody>" + "<body>" * 5000 + "</body>" * 5000 + "</worldbody>", "", "nested more than"),
        ('<size memory="900G"/>', "", "beyond reason"),
        ('<size nuserdata="2000000000"/>', "", "beyond reason"),
        ('<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>', "", "cells"),
        ('<worldbody><replicate count="9999999"><geom size="1"/></replicate></worldbody>', "", "multiply"),
        (
            '<worldbody><replicate count="900"><replicate count="900"><geom size="1"/></replicate></replicate>'
            "</worldbody>",
            "",
            "multiply",
        ),
        ("<keyframe>" + "<key/>" * 20_000 + "</keyframe>", "", "multiply"),
        ('<size nkey="20000000"/>', "", "beyond reason"),
        ('<size nuser_geom="20000000"/>', "", "beyond reason"),
        ('<option iterations="2000000000" tolerance="0"/>', "", "beyond reason"),
        ('<option timestep="1e-12"/>', "", "timestep"),
        ('<asset><mesh name="m" builtin="cone" params="100000000 1"/></asset>', "", "facets"),
        ('<sensor><user dim="1000000000"/></sensor>', "", "cells"),
        (f'<include file="{"a" * 5000}.xml"/>', "", "not there"),
        ("<worldbody>", "", "no well-formed XML"),
    ],
)
def test_what_is_hostile_is_refused_in_one_line(model, inner: str, before: str, said: str) -> None:
    with pytest.raises(BadInput, match=re.escape(said)) as caught:
        compile_model(model(inner, before))
    assert "\n" not in str(caught.value)


def test_a_link_out_of_the_folder_is_a_way_out_as_well(model, tmp_path: Path) -> None:
    (tmp_path / "outside.xml").write_text(f"<mujoco>{BODY}</mujoco>")
    path = model('<include file="inside.xml"/>')
    (path.parent / "inside.xml").symlink_to(tmp_path / "outside.xml")
    with pytest.raises(BadInput, match="outside its folder"):
        compile_model(path)


@pytest.mark.parametrize(
    ("inside", "said"),
    [
        ('<mujoco><include file="../secret.xml"/></mujoco>', "outside its folder"),
        (
            '<mujoco><worldbody><body name="b"><replicate count="200"><geom/></replicate></body></worldbody></mujoco>',
            "multiply",
        ),
    ],
)
def test_a_model_that_is_attached_is_looked_at_as_well(model, tmp_path: Path, inside: str, said: str) -> None:
    (tmp_path / "secret.xml").write_text(f"<mujoco>{BODY}</mujoco>")
    attach = '<worldbody><replicate count="200"><frame><attach model="s" body="b"/></frame></replicate></worldbody>'
    path = model(f'<asset><model name="s" file="sub.xml"/></asset>{attach}')
    (path.parent / "sub.xml").write_text(inside)
    with pytest.raises(BadInput, match=said):
        compile_model(path)


def test_copies_of_an_included_file_are_counted(model) -> None:
    path = model('<worldbody><replicate count="900"><include file="b.xml"/></replicate></worldbody>')
    (path.parent / "b.xml").write_text(
        '<mujocoinclude><replicate count="900"><geom size="1"/></replicate></mujocoinclude>'
    )
    with pytest.raises(BadInput, match="multiply"):
        compile_model(path)


def test_a_picture_that_unpacks_to_more_than_memory_is_not_opened(model) -> None:
    path = model(f'<asset><texture name="t" type="2d" file="t.png"/></asset>{BODY}')
    head = (20_000).to_bytes(4, "big") + (20_000).to_bytes(4, "big") + bytes(5)
    (path.parent / "t.png").write_bytes(b"\x89PNG\r\n\x1a\n" + (13).to_bytes(4, "big") + b"IHDR" + head)
    with pytest.raises(BadInput, match="cells"):
        compile_model(path)


def test_a_pipe_in_place_of_a_mesh_does_not_hang(model) -> None:
    path = model(f'<asset><mesh name="m" file="m.stl"/></asset>{BODY}')
    os.mkfifo(path.parent / "m.stl")
    with pytest.raises(BadInput, match="no file"):
        compile_model(path)


def test_files_that_include_each_other_end(model) -> None:
    model('<include file="it.xml"/>', name="loop.xml")
    with pytest.raises(BadInput):
        compile_model(model('<include file="loop.xml"/>'))


def stl(path: Path, facets: int) -> None:
    """A binary STL of a sphere of triangles, as large as its number of facets says."""
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(facets, 3, 3))
    corners /= np.linalg.norm(corners, axis=2, keepdims=True)
    records = np.zeros(facets, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    records["corners"] = corners
    path.write_bytes(bytes(80) + np.uint32(facets).tobytes() + records.tobytes())


def test_a_mesh_that_is_asked_for_again_and_again_counts_each_time(model) -> None:
    def meshes(count: int) -> str:
        named = "".join(f'<mesh name="m{n}" file="m.stl"/>' for n in range(count))
        return f"<asset>{named}</asset>{BODY}"

    path = model(meshes(2))
    stl(path.parent / "m.stl", 2000)
    assert compile_model(path).nmesh == 2
    with (path.parent / "m.stl").open("ab") as file:  # 9.5 MB, of which MuJoCo would read as much as it declares
        file.truncate(9_500_000)
    for count, refused in ((20, False), (22, True), (200, True)):
        path.write_text(f"<mujoco>{meshes(count)}</mujoco>")
        if refused:
            with pytest.raises(BadInput, match="as often as it is asked for"):
                screen_mjcf(path)
        else:
            screen_mjcf(path)


def test_meshes_of_models_that_are_attached_count_with_every_copy(model) -> None:
    attach = '<worldbody><replicate count="30"><frame><attach model="s" body="b"/></frame></replicate></worldbody>'
    path = model(f'<asset><model name="s" file="sub.xml"/></asset>{attach}')
    inside = '<asset><mesh name="m" file="m.stl"/></asset><worldbody><body name="b"><geom size="1"/></body></worldbody>'
    (path.parent / "sub.xml").write_text(f"<mujoco>{inside}</mujoco>")
    (path.parent / "m.stl").write_bytes(bytes(9_500_000))
    with pytest.raises(BadInput, match="as often as it is asked for"):
        screen_mjcf(path)
