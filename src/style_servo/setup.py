"""Build of style_servo."""
from setuptools import find_packages, setup

NAME = 'style_servo'

setup(
    name=NAME,
    version='0.1.0',
    description='The way to the motors: servo bridge, back ends, and a simulated Dynamixel bus.',
    license='Apache-2.0',
    maintainer='The style motion developers',
    maintainer_email='style-motion@example.org',
    packages=find_packages(include=[NAME, NAME + '.*']),
    python_requires='>=3.10',
    install_requires=['numpy>=1.21,<3', 'style_core', 'dynamixel-sdk>=4.1', 'pyserial', 'pyyaml'],
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + NAME]),
        ('share/' + NAME, ['package.xml']),
    ],
    entry_points={'console_scripts': [
        'bridge = style_servo.bridge_node:main',
        'dynamixel_sim = style_servo.dynamixel_sim:main',
        'flight_record = style_servo.record:main',
    ]},
    zip_safe=False,
)
