"""Every system test stays on this machine and in a domain of its own."""
import os
import sys
from pathlib import Path

os.environ['ROS_LOCALHOST_ONLY'] = '1'
os.environ.setdefault('OMP_NUM_THREADS', '1')
sys.path.insert(0, str(Path(__file__).parent))
