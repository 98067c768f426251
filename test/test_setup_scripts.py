"""The set-up's parts that need neither network nor minutes; whole machines are played by ``make test-setup``."""
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'scripts'))

from ros_prefix import debian, downloads, licence  # noqa: E402

pytestmark = [pytest.mark.no_middleware,
              pytest.mark.skipif(sys.version_info < (3, 12), reason='the prefix is built with CPython 3.12')]


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv('STYLE_CACHE', str(tmp_path / 'cache'))
    return downloads.cache_folder()


@pytest.fixture
def package(tmp_path):
    """A Debian package written by ar and tar, with members of odd length."""
    tree = tmp_path / 'tree/usr/include'
    tree.mkdir(parents=True)
    tree.joinpath('one.h').write_text('#define ONE 1\n')
    tree.joinpath('link.h').symlink_to('one.h')
    subprocess.run(['tar', '-cJf', 'data.tar.xz', '-C', 'tree', '.'], cwd=tmp_path, check=True)
    tmp_path.joinpath('debian-binary').write_text('2.0\n\n')
    subprocess.run(['ar', 'rc', 'one.deb', 'debian-binary', 'data.tar.xz'], cwd=tmp_path, check=True)
    return tmp_path / 'one.deb'


def test_a_package_of_ar_and_tar_is_unpacked(package, tmp_path):
    debian.unpack(package, tmp_path / 'out')
    assert tmp_path.joinpath('out/usr/include/link.h').read_text() == '#define ONE 1\n'
    assert tmp_path.joinpath('out/usr/include/link.h').is_symlink()


@pytest.mark.parametrize('keep', [0, 5, 40, 100, -40])
def test_a_package_cut_short_is_refused(package, tmp_path, keep):
    package.write_bytes(package.read_bytes()[:keep])
    with pytest.raises(downloads.SetupError, match=r'Debian package|damaged|cut short|holds no files'):
        debian.unpack(package, tmp_path / 'out')


@pytest.mark.parametrize('text', ['', '\xff\x00 \n', 'one_word\n', 'gone.whl 00\n', 'one.whl\n'])
def test_a_damaged_list_of_downloads_is_not_believed(tmp_path, text):
    tmp_path.joinpath('one.whl').write_bytes(b'content')
    digest = downloads.sha256(tmp_path / 'one.whl')
    pins = {'one': {digest}}
    listed = tmp_path / 'list'
    listed.write_text(f'one.whl {digest}\n')
    assert downloads.whole(listed, tmp_path, pins)
    assert not downloads.whole(listed, tmp_path, {**pins, 'two': {'1' * 64}})
    listed.write_bytes(text.encode('latin1'))
    assert not downloads.whole(listed, tmp_path, pins)


def test_every_pin_has_a_hash():
    for lock in sorted(downloads.REQUIREMENTS.glob('*.txt')):
        if lock.name != 'debian_headers.txt':
            pins = downloads.pinned(lock)
            assert pins
            assert all(pins.values()), lock


def test_pip_takes_the_way_to_packages_from_its_configuration_and_nothing_else(cache, tmp_path, monkeypatch):
    for name in [name for name in downloads.os.environ if name.startswith('PIP_')]:
        monkeypatch.delenv(name)
    tmp_path.joinpath('pip.conf').write_text('[global]\nuser = true\nindex-url = https://mirror.example/simple\n'
                                             '[install]\ntarget = /nowhere\n')
    monkeypatch.setenv('PIP_CONFIG_FILE', str(tmp_path / 'pip.conf'))
    monkeypatch.setenv('PIP_PROXY', 'http://proxy.example')
    downloads.network_settings.cache_clear()
    with downloads.pip_environment(sys.executable) as environment:
        found = {name: value for name, value in environment.items() if name.startswith('PIP_')}
    downloads.network_settings.cache_clear()
    assert found == {'PIP_INDEX_URL': 'https://mirror.example/simple', 'PIP_PROXY': 'http://proxy.example',
                     'PIP_CONFIG_FILE': '/dev/null'}


def test_the_licence_is_said_and_answered_by_a_variable(cache, monkeypatch, capsys):
    monkeypatch.setenv('STYLE_ACCEPT_LICENSE', '0')
    with pytest.raises(downloads.SetupError, match='not accepted; nothing was downloaded'):
        licence.accept()
    assert 'NVIDIA Omniverse License Agreement' in capsys.readouterr().out
    monkeypatch.setenv('STYLE_ACCEPT_LICENSE', '1')
    licence.accept()
    monkeypatch.setenv('STYLE_ACCEPT_LICENSE', '0')
    with pytest.raises(downloads.SetupError):
        licence.accept()
    monkeypatch.delenv('STYLE_ACCEPT_LICENSE')
    monkeypatch.setattr(licence, 'terminal', lambda: True)
    monkeypatch.setattr('builtins.input', lambda prompt: pytest.fail('asked again'))
    licence.accept()


def test_without_a_terminal_nothing_is_asked(cache, monkeypatch):
    monkeypatch.delenv('STYLE_ACCEPT_LICENSE', raising=False)
    monkeypatch.setattr('builtins.input', lambda prompt: pytest.fail('asked'))
    with open('/dev/null') as nobody:
        monkeypatch.setattr('sys.stdin', nobody)
        licence.accept()


@pytest.mark.parametrize('name', ['Bücher', 'my robots', 'a:b', "it's", 'a;b', 'a$b'])
def test_paths_that_the_build_tools_do_not_bear_are_refused(name):
    done = subprocess.run(['bash', '-c', '. scripts/common.sh; check_place'], cwd=ROOT, capture_output=True, text=True,
                          env={'PATH': '/usr/bin:/bin', 'HOME': '/tmp', 'STYLE_ROS_PREFIX': f'/tmp/{name}'})
    assert done.returncode == 1
    assert 'do not bear' in done.stderr
