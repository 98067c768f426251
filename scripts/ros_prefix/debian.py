"""Unpacks Debian packages without Debian's tools: an ar archive (deb(5), ar(5)) that holds a tar archive."""
import io
import shutil
import subprocess
import tarfile

from ros_prefix.downloads import SetupError

MAGIC = b'!<arch>\n'


def members(path):
    """Members of an ar archive: pairs of name and content.

    Raises
    ------
    SetupError
        Where the file is no ar archive or ends too early.
    """
    content = path.read_bytes()
    if not content.startswith(MAGIC):
        raise SetupError(f'{path} is no Debian package')
    place = len(MAGIC)
    while place < len(content):
        header = content[place:place + 60]  # name 16, date 12, owner 6, group 6, mode 8, size 10, end 2
        if len(header) < 60 or header[58:] != b'`\n' or not header[48:58].strip().isdigit():
            raise SetupError(f'{path} is damaged')
        size = int(header[48:58])
        place += 60
        if place + size > len(content):
            raise SetupError(f'{path} is cut short')
        yield header[:16].decode('ascii', 'replace').strip().rstrip('/'), content[place:place + size]
        place += size + size % 2


def decompressed(content, name):
    """Content of data.tar.xz; a Python without lzma leaves it to xz."""
    if not name.endswith('.xz'):
        raise SetupError(f'{name}: only xz is known')
    try:
        import lzma
    except ImportError:
        if not shutil.which('xz'):
            raise SetupError('the header packages are packed with xz, which neither this Python nor the machine has: '
                             'install xz (xz-utils)') from None
        return subprocess.run(['xz', '-dc'], input=content, stdout=subprocess.PIPE, check=True).stdout
    return lzma.decompress(content)


def unpack(path, folder):
    """Unpack the files of one package into ``folder``, which is made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in members(path):
        if name.startswith('data.tar'):
            with tarfile.open(fileobj=io.BytesIO(decompressed(content, name))) as archive:
                archive.extractall(folder, filter='tar')
            return
    raise SetupError(f'{path} holds no files')
