"""Build of style_core: pure Python plus the Cython kernels found in the package."""
import runpy
from pathlib import Path

from Cython.Build import cythonize
from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext

HERE = Path(__file__).parent
NAME = 'style_core'
VERSION = '0.1.0'


def kernels():
    """One extension a .pyx file; kernels use typed memoryviews only, so no NumPy headers are needed."""
    sources = sorted((HERE / NAME).rglob('*.pyx'))
    return [
        Extension('.'.join(path.relative_to(HERE).with_suffix('').parts), [str(path.relative_to(HERE))],
                  include_dirs=[str(path.parent.relative_to(HERE))],
                  depends=[str(header.relative_to(HERE)) for header in sorted(path.parent.glob('*.h'))],
                  # contraction off: the same bits on machines with and without fused multiply-add
                  extra_compile_args=['-O3', '-g0', '-ffp-contract=off', '-fno-math-errno', '-Wno-unused-function',
                                      '-Wno-maybe-uninitialized', '-Wno-psabi'])
        for path in sources]


class BuildKernels(build_ext):
    """Runs Cython only when something is built (colcon reads what this file prints), and compilers side by side."""

    def finalize_options(self):
        self.distribution.ext_modules = cythonize(
            self.distribution.ext_modules, language_level=3, build_dir='build/cython', compiler_directives={
                'boundscheck': False, 'wraparound': False, 'cdivision': True, 'initializedcheck': False})
        super().finalize_options()
        self.parallel = True

    def copy_extensions_to_source(self):
        """A build in place remembers its sources, so that an import can tell that they have changed."""
        super().copy_extensions_to_source()
        runpy.run_path(str(HERE / NAME / 'built.py'))['record'](HERE / NAME)


setup(
    name=NAME,
    version=VERSION,
    description='Phase, style and motion: models, on-line prediction and synthesis. No ROS needed.',
    license='Apache-2.0',
    maintainer='The style motion developers',
    maintainer_email='style-motion@example.org',
    packages=find_packages(include=[NAME, NAME + '.*']),
    ext_modules=kernels(),
    cmdclass={'build_ext': BuildKernels},
    python_requires='>=3.10',
    install_requires=['setuptools', 'numpy>=1.21,<3', 'scipy>=1.8', 'matplotlib>=3.5', 'tqdm>=4.57',
                      'rosbags>=0.11', 'scikit-learn>=1.0', 'pyyaml>=5.4'],
    extras_require={
        'test': ['pytest>=6.2', 'hypothesis>=6', 'filterpy>=1.4', 'hmmlearn>=0.2.7', 'mcap-ros2-support>=0.5',
                 'urdf_parser_py>=0.0.4'],
        'fuzz': ['atheris>=2.3'],
    },
    tests_require=['pytest'],
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + NAME]),
        ('share/' + NAME, ['package.xml']),
    ],
    entry_points={'console_scripts': ['motion-style = style_core.cli:main']},
    zip_safe=False,
)
