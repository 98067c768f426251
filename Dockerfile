# For those who prefer a container. Not built or run by our tests: they have no container runtime.
#   docker build -t style-motion . && docker run --rm -it --network host style-motion
FROM ros:humble
SHELL ["/bin/bash", "-c"]
WORKDIR /style-motion
COPY . .
RUN apt-get update && make setup && rm -rf /var/lib/apt/lists/*
RUN printf '%s\n' 'source /style-motion/install/setup.bash' >> /root/.bashrc
CMD ["bash"]
