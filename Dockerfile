# For those who prefer a container: ROS 2 Humble from apt, none of the PyPI prefix. Not built or run by us: our test
# machine has no container runtime. tests: hadolint, and an independent reader of .dockerignore (make test-setup).
#   docker build -t style-motion .
#   docker run --rm -it --network host --ipc host style-motion ros2 launch style_bringup predict.launch.py --show-args
# --network host and --ipc host: nodes in and outside the container share discovery and Fast DDS's shared memory.
FROM ros:humble
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
WORKDIR /style-motion

# what changes seldom comes first: an edit of a source does not install everything again
COPY scripts/common.sh scripts/complete_humble.sh scripts/
COPY requirements requirements
RUN apt-get update && scripts/complete_humble.sh && rm -rf /var/lib/apt/lists/*

COPY . .
RUN scripts/build.sh

ENTRYPOINT ["/style-motion/scripts/docker_entry.sh"]
CMD ["bash"]
