"""`burnish export` and `--materialx` as users type them."""

from __future__ import annotations

from pathlib import Path

from tests.app.conftest import Runner, contents


def test_export_says_what_it_wrote_and_what_it_could_not(
    burnish: Runner, bundle: Path, tmp_path: Path
) -> None:
    """From a bundle, whose scene is found again; the edits are those of the line."""
    outcome = burnish(
        "export", bundle, "-o", "box.xml", "--set", "back.specular.weight=0.2",
        "--set", "left.diffuse.color=#c83c28", cwd=tmp_path,
    )  # fmt: skip
    assert outcome.code == 0, outcome.err
    remark, place = outcome.out.splitlines()
    assert remark.startswith("back: a fitted blend of diffuse and roughconductor: ")
    assert remark.endswith("the exact material is in box_files/back.json")
    assert place == "box.xml"
    assert set(contents(tmp_path)) == {"box.xml", "box_files", "box_files/back.json"}
    assert burnish("info", "box.xml", cwd=tmp_path).code == 0


def test_materialx_goes_out_and_comes_in(burnish: Runner, tmp_path: Path) -> None:
    assert (
        burnish(
            "export", "cornell-box", "-o", "look.mtlx", "--object", "left",
            "--set", "left.diffuse.color=0.1,0.2,0.3", cwd=tmp_path,
        ).code
        == 0
    )  # fmt: skip
    outcome = burnish(
        "export", "cornell-box", "-o", "box.xml", "--materialx", "right=look.mtlx#m_left",
        cwd=tmp_path,
    )  # fmt: skip
    assert outcome.code == 0, outcome.err
    assert '<rgb name="reflectance" value="0.1 0.2 0.3" />' in (tmp_path / "box.xml").read_text()


def test_bad_exports_are_one_line(burnish: Runner, tmp_path: Path) -> None:
    for arguments, message in (
        (("-o", "box.xml", "--format", "usd"), "--format must be one of"),
        (("-o", "box.xml", "--object", "teapot"), "no object named 'teapot'"),
        (("-o", "box.xml", "--materialx", "gone.mtlx"), "no MaterialX file"),
    ):
        outcome = burnish("export", "cornell-box", *arguments, cwd=tmp_path)
        assert message in outcome.complaint, outcome.err
    assert contents(tmp_path) == {}
