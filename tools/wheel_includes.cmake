# SPDX-License-Identifier: Apache-2.0
# Read after every project() of the workspace (CMAKE_PROJECT_INCLUDE), when ROS comes from wheels.
#
# The wheels' exported targets name the Python and numpy headers of the machine they were built
# on, and CMake refuses include folders that do not exist. At the end of a project's configuration
# all its imported targets are known: point them to the headers of this machine.
function(_use_headers_of_this_machine)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(folders ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(folders MATCHES "/opt/python/")
      list(FILTER folders EXCLUDE REGEX "/opt/python/")
      list(APPEND folders ${Python3_INCLUDE_DIRS} ${Python3_NumPy_INCLUDE_DIRS})
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${folders}")
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL _use_headers_of_this_machine)
