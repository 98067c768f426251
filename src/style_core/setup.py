"""Build of style_core: pure Python plus the Cython kernels found in the package.

What the package is and needs stands in setup.cfg and not in the [project] table of pyproject.toml: the setuptools of
Ubuntu 22.04 (59), with which colcon builds there, does not read that table.
"""
import hashlib
import json
import os
import runpy
import shutil
import sysconfig
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

HERE = Path(__file__).parent
NAME = 'style_core'
README = HERE / 'README.md'  # colcon builds in a folder of links that lacks it
BUILT = runpy.run_path(str(HERE / NAME / 'built.py'))


def kernels():
    """One extension a .pyx file; kernels use typed memoryviews only, so no NumPy headers are needed."""
    sources = sorted((HERE / NAME).rglob('*.pyx'))
    if not sources:
        raise SystemExit(f'{HERE / NAME} holds no .pyx file: this copy of the sources is not whole, and a package '
                         'without its kernels would not work')
    return [
        Extension('.'.join(path.relative_to(HERE).with_suffix('').parts), [str(path.relative_to(HERE))],
                  include_dirs=[str(path.parent.relative_to(HERE))],
                  depends=[str(header.relative_to(HERE)) for header in sorted(path.parent.glob('*.h'))],
                  # contraction off: the same bits on machines with and without fused multiply-add
                  extra_compile_args=['-O3', '-g0', '-ffp-contract=off', '-fno-math-errno', '-Wno-unused-function',
                                      '-Wno-maybe-uninitialized', '-Wno-psabi'])
        for path in sources]


def cython():
    """The Cython package; one sentence where there is none that can compile the kernels."""
    try:
        import Cython
    except ImportError:
        raise SystemExit('The kernels of style_core need Cython 3 to be built: pip install "Cython>=3,<4"') from None
    if int(Cython.__version__.split('.')[0]) < 3:
        raise SystemExit(f'The kernels of style_core need Cython 3, and this is {Cython.__version__} (Ubuntu 22.04 has '
                         'no newer one): pip install --user "Cython>=3,<4"')
    return Cython


def need_compiler():
    """One sentence, before Cython runs, where nothing can compile what it writes."""
    from distutils.ccompiler import new_compiler
    from distutils.sysconfig import customize_compiler
    compiler = new_compiler()
    customize_compiler(compiler)
    command = getattr(compiler, 'compiler_so', ['cc'])[0]
    if shutil.which(command) is None:
        raise SystemExit(f'style_core needs a C compiler to build its kernels, and {command} is not on PATH: install '
                         'one (Debian, Ubuntu: sudo apt install gcc libc6-dev; Fedora: sudo dnf install gcc)')
    if not Path(sysconfig.get_path('include'), 'Python.h').exists():
        raise SystemExit('style_core needs the C headers of this Python to build its kernels: install them (Debian, '
                         'Ubuntu: sudo apt install python3-dev; Fedora: sudo dnf install python3-devel)')


class BuildKernels(build_ext):
    """Builds the kernels that have changed, by content; compilers run side by side."""

    def finalize_options(self):
        super().finalize_options()
        self.parallel = True

    def run(self):
        """Cython runs here only: what merely reads this file (colcon, an sdist) needs neither it nor a compiler."""
        digests = {**BUILT['digests'](HERE / NAME), 'setup.py': hashlib.sha256(
            Path(__file__).read_bytes() + cython().__version__.encode()).hexdigest()}
        every, self.extensions = self.extensions, [ext for ext in self.extensions if self.stale(ext, digests)]
        if self.extensions:
            need_compiler()
            self.record.unlink(missing_ok=True)
            self.write_c()
            self.force = True
        super().run()
        self.extensions = every
        self.record.parent.mkdir(parents=True, exist_ok=True)
        self.record.write_text(json.dumps(digests, indent=1))

    @property
    def record(self):
        """What the built kernels were made from; beside those built in place an import reads it."""
        if self.inplace:
            return BUILT['record_path'](HERE / NAME)
        return Path(self.build_temp, 'kernels.json')

    def stale(self, extension, digests):
        """Is this kernel not there, or made from something else?"""
        try:
            built = json.loads(self.record.read_text())
        except (OSError, ValueError):
            return True
        place = Path(self.get_ext_fullpath(extension.name))
        source = Path(extension.sources[0]).relative_to(NAME).as_posix()
        return not place.exists() or any(built.get(name) != digests[name] for name in (source, 'setup.py'))

    def write_c(self):
        """Have Cython write the C of ``extensions``, which afterwards name that instead of the .pyx."""
        from Cython.Build import cythonize
        written = cythonize(
            self.extensions, language_level=3, build_dir='build/cython', force=True, nthreads=os.cpu_count() or 1,
            compiler_directives={'boundscheck': False, 'wraparound': False, 'cdivision': True,
                                 'initializedcheck': False})
        sources = {extension.name: extension.sources for extension in written}
        for extension in self.extensions:
            extension.sources = sources[extension.name]


setup(
    ext_modules=kernels(),
    cmdclass={'build_ext': BuildKernels},
    long_description=README.read_text() if README.exists() else '',
    long_description_content_type='text/markdown',
    python_requires='>=3.10',  # in setup.cfg it becomes an object, which colcon cannot read
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + NAME]),
        ('share/' + NAME, ['package.xml']),
    ],
    zip_safe=False,
)
