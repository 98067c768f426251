# Packages are built with the prefix's own Python, whichever python3 the machine's default is.
set(Python3_EXECUTABLE "@PYTHON@" CACHE FILEPATH "Python of the ROS prefix")
set(PYTHON_EXECUTABLE "@PYTHON@" CACHE FILEPATH "Python of the ROS prefix")
set(Python3_INCLUDE_DIR "@INCLUDE@" CACHE PATH "Python of the ROS prefix")
set(PYTHON_INCLUDE_DIR "@INCLUDE@" CACHE PATH "Python of the ROS prefix")
set(Python3_LIBRARY "@LIBRARY@" CACHE FILEPATH "Python of the ROS prefix")
set(PYTHON_LIBRARY "@LIBRARY@" CACHE FILEPATH "Python of the ROS prefix")

