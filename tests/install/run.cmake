# Installs BUILD into a fresh prefix, then builds and runs a project that finds it there.
#   cmake -DBUILD=... -DCONSUMER=... -DWORK=... -DGENERATOR=... -DCOMPILER=... [-DCONFIG=...] -P run.cmake
file(REMOVE_RECURSE ${WORK})
execute_process(COMMAND ${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/prefix --config "${CONFIG}"
                OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
# The build tree's own sources must not be needed: nothing in the package may name them.
file(GLOB_RECURSE package ${WORK}/prefix/*.cmake)
foreach(file IN LISTS package)
  file(READ ${file} text)
  foreach(folder ${BUILD} ${SOURCE})
    string(FIND "${text}" "${folder}" place)
    if(NOT place EQUAL -1)
      message(FATAL_ERROR "${file} names ${folder}")
    endif()
  endforeach()
endforeach()
execute_process(
  COMMAND ${CMAKE_COMMAND} -S ${CONSUMER} -B ${WORK}/build -G ${GENERATOR}
          -DCMAKE_CXX_COMPILER=${COMPILER} -DCMAKE_CXX_COMPILER_LAUNCHER=${LAUNCHER}
          -DCMAKE_PREFIX_PATH=${WORK}/prefix -DCMAKE_BUILD_TYPE=${CONFIG}
          -DCMAKE_FIND_PACKAGE_NO_PACKAGE_REGISTRY=ON
          COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} --build ${WORK}/build COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${WORK}/build/consumer OUTPUT_VARIABLE models COMMAND_ERROR_IS_FATAL ANY)
if(NOT models MATCHES "pinhole-radial3\n")
  message(FATAL_ERROR "The consumer does not list pinhole-radial3 but: ${models}")
endif()
file(REMOVE_RECURSE ${WORK})
