import pytest

import install_ros2_fallback as installer


@pytest.fixture
def binaries(tmp_path, monkeypatch):
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    return folder


def real(folder):
    folder.mkdir(exist_ok=True)
    (folder / "ros2").write_text("#!/bin/sh\n")
    (folder / "ros2").chmod(0o755)


def test_it_is_installed_where_there_is_none_and_again_changes_nothing(binaries):
    assert "is the project's fallback" in installer.install(binaries)
    assert (binaries / "ros2").resolve() == installer.FALLBACK
    assert not (binaries / "ros2").readlink().is_absolute()
    assert "already" in installer.install(binaries)
    assert (binaries / "ros2").resolve() == installer.FALLBACK


def test_a_real_one_elsewhere_on_the_path_wins(binaries, tmp_path, monkeypatch):
    real(tmp_path / "ros")
    monkeypatch.setenv("PATH", f"{binaries}:{tmp_path / 'ros'}")
    assert "no fallback needed" in installer.install(binaries)
    assert not (binaries / "ros2").exists()


def test_a_real_one_that_came_later_takes_it_away(binaries, tmp_path, monkeypatch):
    installer.install(binaries)
    real(tmp_path / "ros")
    monkeypatch.setenv("PATH", f"{binaries}:{tmp_path / 'ros'}")
    assert "taken away" in installer.install(binaries)
    assert not (binaries / "ros2").is_symlink()


def test_a_real_one_in_the_same_folder_is_left_alone(binaries):
    real(binaries)
    assert "left as it is" in installer.install(binaries)
    assert (binaries / "ros2").read_text() == "#!/bin/sh\n"
