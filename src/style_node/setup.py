"""Build of style_node."""
from setuptools import find_packages, setup

NAME = 'style_node'

setup(
    name=NAME,
    version='0.1.0',
    description='What every node of the suite is made of: executor, lifecycle, parameters, diagnostics.',
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
    zip_safe=False,
)
