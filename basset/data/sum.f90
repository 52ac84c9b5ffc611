! @title@
!
! @promise@
! The history integral H(t) = sum of jumps*K + integral K(t - tau) g(tau) dtau of samples of the rate g = df/dt, every step:
! @recursion@
!
!     type(history) :: h
!     call h%push(g0, value)      ! the first sample, at the first node
!     call h%jump(f0)             ! the initial slip, and later any jump of f at the newest node
!     call h%push(g1, value)      ! H at the next node
!
! From node last on H = (what is known before) + newest(0)*g: solve for g where it depends on H.
! Made by: @command@
module basset_sum
  use, intrinsic :: iso_fortran_env, only: real64
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  implicit none
  private
  public :: history, kernel_sum, deviation
  integer, parameter, public :: terms = @terms@, last = @last@, window = @window@, steps = @steps@
  real(real64), parameter, public :: near = @near@, far = @far@, tolerance = @rtol@, step = @dt@
@arrays@
  type :: history
    integer :: count = 0                                ! samples so far
    real(real64) :: sample(0:last) = 0                  ! newest first
    real(real64) :: term(terms) = 0                     ! one number per exponential
    real(real64) :: coming(window) = 0                  ! what jumps add at the next nodes beyond their exponentials
  contains
    procedure :: push, jump
  end type history
contains
  ! K(lag) as the sum, near <= lag <= far
  pure real(real64) function kernel_sum(lag)
    real(real64), intent(in) :: lag
    kernel_sum = sum(weight*exp(-rate*lag))
  end function kernel_sum

  ! H at the next node, where the rate is g; NaN more than `steps` after the first
  subroutine push(self, g, value)
    class(history), intent(inout) :: self
    real(real64), intent(in) :: g
    real(real64), intent(out) :: value
    real(real64) :: gained(terms)
    value = ieee_value(value, ieee_quiet_nan)
    if (self%count > steps) return
    self%sample = [g, self%sample(:last - 1)]
    if (self%count < last) then
      value = dot_product(start(:, self%count), self%sample)
      gained = 0
    else
      value = dot_product(newest, self%sample)
      gained = gain*self%sample(last)
      if (self%count == last) gained = matmul(self%sample, entry)
    end if
    self%term = self%term + (gained - loss*self%term)
    value = value + sum(self%term) + self%coming(1)
    self%coming = [self%coming(2:), 0.0_real64]
    self%count = self%count + 1
  end subroutine push

  ! f jumps by delta at the newest node
  subroutine jump(self, delta)
    class(history), intent(inout) :: self
    real(real64), intent(in) :: delta
    self%term = self%term + delta*weight
    self%coming = self%coming + delta*excess
  end subroutine jump

  ! Relative deviation from the value that basset found for g = 1/(1 + k) at node k = 0 ... @test_steps@ and an initial slip of 1
  real(real64) function deviation()
    type(history) :: h
    real(real64) :: value
    integer :: k
    call h%push(1.0_real64, value)
    call h%jump(1.0_real64)
    do k = 1, @test_steps@
      call h%push(1.0_real64/(1 + k), value)
    end do
    deviation = value/(@test_value@) - 1
  end function deviation
end module basset_sum
