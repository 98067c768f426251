"""Build of style_synth."""
from setuptools import find_packages, setup

NAME = 'style_synth'

setup(
    name=NAME,
    version='0.1.0',
    description='Node: the synthesizer, which streams trajectories in any style to a robot.',
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
        'synthesizer = style_synth.synthesizer_node:main',
        'style_slider = style_synth.style_slider:main',
    ]},
    zip_safe=False,
)
