! @title@
!
! H at the newest of steps + 1 nodes = sum of weight(j)*g(j), the newest sample first.
! Made by: @command@
module basset_weights
  use, intrinsic :: iso_fortran_env, only: real64
  implicit none
  private
  public :: history, deviation
  integer, parameter, public :: steps = @steps@
  real(real64), parameter, public :: step = @dt@
@arrays@
contains
  ! H from samples at steps + 1 nodes, the oldest first, as they come
  pure real(real64) function history(g)
    real(real64), intent(in) :: g(0:steps)
    history = dot_product(weight, g(steps:0:-1))
  end function history

  ! The same for g = 1/(1 + k) at node k, over the value that basset found, less 1
  real(real64) function deviation()
    integer :: k
    deviation = history([(1.0_real64/(1 + k), k = 0, steps)])/(@test_value@) - 1
  end function deviation
end module basset_weights
