"""Every package.xml declares what its package imports, and the manifests are read by catkin_pkg, which is not ours."""
import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from catkin_pkg import package as catkin

pytestmark = pytest.mark.no_middleware
ROOT = Path(__file__).resolve().parents[1]
PACKAGES = sorted(path.parent for path in ROOT.glob('src/*/package.xml'))
#: key of a module whose package is not called as the module is
KEYS = {
    **{name: f'python3-{name}' for name in ('numpy', 'scipy', 'matplotlib', 'tqdm', 'yaml', 'pytest', 'hypothesis',
                                                'serial', 'argcomplete')},
    'sklearn': 'python3-sklearn', 'rosbags': 'python3-rosbags-pip', 'Cython': 'python3-cython3-pip',
    'urdf_parser_py': 'urdfdom_py', 'dynamixel_easy_sdk': 'dynamixel_sdk', '_pytest': 'python3-pytest',
}
#: asked for where they are used, with what to install; no distribution's package holds them
OPTIONAL = {'viser', 'trimesh', 'pyarrow', 'playwright', 'rustypot'}


def imported(folder):
    """Packages outside the standard library that files of a folder import, wherever in the file."""
    names = set()
    own = {folder.name} if folder.joinpath('__init__.py').exists() else set()
    for path in folder.rglob('*.py'):
        own.add(path.stem)
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names.update(alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module)
    return {name.partition('.')[0] for name in names} - own - set(sys.stdlib_module_names)


def keys(modules):
    """The keys under which package.xml names these modules."""
    return {KEYS.get(module, module) for module in modules} - OPTIONAL


@pytest.fixture(params=PACKAGES, ids=lambda path: path.name)
def manifest(request):
    return request.param, catkin.parse_package(str(request.param))


def test_imports_of_a_package_are_declared(manifest):
    folder, package = manifest
    wanted = keys(imported(folder / folder.name))
    if folder.name == 'style_bringup':
        wanted = keys(imported(ROOT / 'launch'))
    assert wanted - {depend.name for depend in [*package.exec_depends, *package.build_depends]} - {folder.name} == set()


def test_imports_of_its_tests_are_declared(manifest):
    folder, package = manifest
    declared = {depend.name for depend in [*package.exec_depends, *package.test_depends]}
    assert keys(imported(folder / 'test')) - declared - {folder.name} == set()


def test_keys_that_the_distribution_lacks_have_a_rule(manifest):
    rules = yaml.safe_load(ROOT.joinpath('requirements/rosdep.yaml').read_text())
    named = set(re.findall(r'>(python3-[\w-]+-pip)<', manifest[0].joinpath('package.xml').read_text()))
    assert named - set(rules) == set()


def test_manifest_and_setup_agree(manifest):
    folder, package = manifest
    package.validate()
    assert package.licenses == ['Apache-2.0']
    version = re.search(r"__version__ = '(.*)'", ROOT.joinpath('src/style_core/style_core/__init__.py').read_text())[1]
    assert package.version == version
    if folder.joinpath('setup.py').exists():
        text = folder.joinpath('setup.py').read_text()
        assert 'setuptools' not in ''.join(re.findall(r'install_requires=\[.*?\]', text, re.DOTALL))


def test_no_file_compares_nothing():
    """The comparison sees imports at all: it would pass on empty sets."""
    assert {'rclpy', 'numpy', 'serial', 'dynamixel_sdk'} <= imported(ROOT / 'src/style_servo/style_servo')
    assert {'launch', 'lifecycle_msgs'} <= imported(ROOT / 'launch')


def test_every_pinned_package_is_in_the_table_of_licences():
    done = subprocess.run([sys.executable, ROOT / 'scripts/third_party_licences.py', '--check'], capture_output=True,
                          text=True)
    assert done.returncode == 0, done.stderr
