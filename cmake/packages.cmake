# Packages for the Debian that makes them (scripts/deb): plenocal, libplenocal-dev, python3-plenocal.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME plenocal)
set(CPACK_PACKAGE_VENDOR "The Plenocal contributors")
set(PLENOCAL_MAINTAINER "The Plenocal contributors <maintainers@plenocal.invalid>"
    CACHE STRING "Name and address of whoever answers for the packages")
set(CPACK_PACKAGE_CONTACT "${PLENOCAL_MAINTAINER}")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "calibration of plenoptic and ordinary cameras")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ
                                                WORLD_EXECUTE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL program dev)
if(PLENOCAL_PYTHON)
  list(APPEND CPACK_COMPONENTS_ALL python)
  find_package(Python REQUIRED COMPONENTS Interpreter) # the extension belongs to its minor version
  math(EXPR next "${Python_VERSION_MINOR} + 1")
endif()
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_DEV_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)

set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME plenocal)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION science)
set(CPACK_DEBIAN_DEV_PACKAGE_NAME libplenocal-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-plenocal)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "python3 (>= 3.${Python_VERSION_MINOR}), python3 (<< 3.${next}), python3-numpy")
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS
    "libceres-dev, libeigen3-dev, libfmt-dev, libgoogle-glog-dev, libpugixml-dev, libyaml-cpp-dev")
# It has the program that decodes videos.
set(CPACK_DEBIAN_DEV_PACKAGE_RECOMMENDS plenocal)
set(CPACK_COMPONENT_PROGRAM_DESCRIPTION
    "Calibrates ordinary cameras, fisheyes, focused plenoptic cameras and rigs of
them from images of a target, in one bundle adjustment, with standard errors,
a verdict and a report. This package has the program.")
set(CPACK_COMPONENT_DEV_DESCRIPTION
    "Calibrates ordinary cameras, fisheyes, focused plenoptic cameras and rigs of
them from images of a target. This package has the static libraries and headers
of camera models and bundle adjustment, for programs and plug-ins.")
set(CPACK_COMPONENT_PYTHON_DESCRIPTION
    "Calibrates ordinary cameras, fisheyes, focused plenoptic cameras and rigs of
them from images of a target. This package has the module for Python 3.")
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/cmake/debian_files.cmake)
# The targets of the packages alone are built, by scripts/deb.
set(CMAKE_SKIP_INSTALL_ALL_DEPENDENCY ON)
include(CPack)
