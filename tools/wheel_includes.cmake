# SPDX-License-Identifier: Apache-2.0
# CMake reads this file after every project() of the workspace (CMAKE_PROJECT_INCLUDE) if ROS is
# installed from wheels.
#
# The exported targets of the wheels refer to the Python and numpy headers of the machine that built
# the wheels, and CMake refuses include folders that do not exist. All imported targets of a project
# are defined at the end of its configuration: this function points them to the headers of this
# machine.
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
