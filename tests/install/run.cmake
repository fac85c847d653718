# Installs BUILD into a fresh prefix, then builds and runs a project that finds it there, and does what
# docs/new_model.md says.
#   cmake -DBUILD=... -DSOURCE=... -DCONSUMER=... -DWORK=... -DGENERATOR=... -DCOMPILER=... [-DCONFIG=...] -P run.cmake
file(REMOVE_RECURSE ${WORK})
execute_process(COMMAND ${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/prefix --config "${CONFIG}"
                OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
# The build tree's own sources must not be needed: nothing in the package may name them.
file(GLOB_RECURSE package ${WORK}/prefix/*.cmake)
foreach(file IN LISTS package)
  file(READ ${file} text)
  foreach(folder ${BUILD} ${SOURCE})
    # As a whole path: a source folder /plenocal is also the end of include/plenocal.
    if(text MATCHES "[^a-zA-Z0-9_}]${folder}[/\";]")
      message(FATAL_ERROR "${file} names ${folder}")
    endif()
  endforeach()
endforeach()
function(build_project source folder)
  execute_process(
    COMMAND ${CMAKE_COMMAND} -S ${source} -B ${folder} -G ${GENERATOR}
            -DCMAKE_CXX_COMPILER=${COMPILER} -DCMAKE_CXX_COMPILER_LAUNCHER=${LAUNCHER}
            -DCMAKE_PREFIX_PATH=${WORK}/prefix -DCMAKE_BUILD_TYPE=${CONFIG}
            -DCMAKE_FIND_PACKAGE_NO_PACKAGE_REGISTRY=ON
            COMMAND_ERROR_IS_FATAL ANY)
  execute_process(COMMAND ${CMAKE_COMMAND} --build ${folder} COMMAND_ERROR_IS_FATAL ANY)
endfunction()
build_project(${CONSUMER} ${WORK}/build)
execute_process(COMMAND ${WORK}/build/consumer OUTPUT_VARIABLE models COMMAND_ERROR_IS_FATAL ANY)
if(NOT models MATCHES "pinhole-radial3\n")
  message(FATAL_ERROR "The consumer does not list pinhole-radial3 but: ${models}")
endif()

# The engine from another program, with images in memory.
build_project(${SOURCE}/examples/embed ${WORK}/embed)
file(GLOB images ${SOURCE}/tests/data/frames/stereo_chess_opencv/left*.jpg)
execute_process(COMMAND ${WORK}/embed/embed chessboard:9x6:25mm ${images} OUTPUT_VARIABLE printed COMMAND_ERROR_IS_FATAL ANY)
if(NOT printed MATCHES "f_x = 53[0-9.]+ \\+- [0-9.]+ px\n.* is imaged at ")
  message(FATAL_ERROR "examples/embed printed: ${printed}")
endif()

# The walk through docs/new_model.md: its shell commands in the example's folder, then its CMake template.
file(COPY ${SOURCE}/examples DESTINATION ${WORK})
file(READ ${SOURCE}/docs/new_model.md rest)
set(commands "set -eux\n")
while(rest MATCHES "\n```sh\n([^`]*)\n```\n")
  set(block "${CMAKE_MATCH_0}")
  string(APPEND commands "${CMAKE_MATCH_1}\n")
  string(FIND "${rest}" "${block}" place)
  string(LENGTH "${block}" length)
  math(EXPR place "${place} + ${length}")
  string(SUBSTRING "${rest}" ${place} -1 rest)
endwhile()
file(WRITE ${WORK}/commands.sh "${commands}")
file(GLOB pkgconfig ${WORK}/prefix/*/pkgconfig ${WORK}/prefix/*/*/pkgconfig)
execute_process(
  COMMAND ${CMAKE_COMMAND} -E env PATH=${WORK}/prefix/bin:$ENV{PATH} PKG_CONFIG_PATH=${pkgconfig} sh ${WORK}/commands.sh
  WORKING_DIRECTORY ${WORK}/examples/new_model
  OUTPUT_VARIABLE printed COMMAND_ERROR_IS_FATAL ANY)
foreach(line "same within uncertainty" "[* ] stereographic .*(best|recommended)")
  if(NOT printed MATCHES "\n${line}")
    message(FATAL_ERROR "The commands of docs/new_model.md did not print '${line}' but: ${printed}")
  endif()
endforeach()
build_project(${WORK}/examples/new_model ${WORK}/template)
execute_process(
  COMMAND ${WORK}/prefix/bin/plenocal --plugin ${WORK}/template/libstereographic.so models check stereographic
  OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
file(REMOVE_RECURSE ${WORK})
