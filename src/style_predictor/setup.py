"""Build of style_predictor."""
from setuptools import find_packages, setup

NAME = 'style_predictor'

setup(
    name=NAME,
    version='0.1.0',
    description='Nodes: the on-line motion predictor and the motion player.',
    license='Apache-2.0',
    maintainer='The style motion developers',
    maintainer_email='style-motion@example.org',
    packages=find_packages(include=[NAME, NAME + '.*']),
    python_requires='>=3.10',
    install_requires=['numpy>=1.21,<3', 'style_core'],
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + NAME]),
        ('share/' + NAME, ['package.xml']),
    ],
    entry_points={'console_scripts': [
        'predictor = style_predictor.predictor_node:main',
        'motion_player = style_predictor.player_node:main',
    ]},
    zip_safe=False,
)
