//! Fused elementwise loops over contiguous columns.
//!
//! Each body is compiled for baseline, AVX2 and AVX-512 and picked at run time. Closures given to
//! a dispatcher are not reliably inlined into the wider version (then a fused multiply-add is a
//! library call and the loop 20 times slower), hence the macro.
#![allow(unsafe_code)]

macro_rules! multiversion {
    ($(#[$meta:meta])* fn $name:ident($($arg:ident: $type:ty),* $(,)?) $body:block) => {
        $(#[$meta])*
        pub(crate) fn $name($($arg: $type),*) {
            #[inline(always)]
            fn body($($arg: $type),*) $body
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
                fn avx512($($arg: $type),*) { body($($arg),*) }
                #[target_feature(enable = "avx2,fma")]
                fn avx2($($arg: $type),*) { body($($arg),*) }
                let fma = is_x86_feature_detected!("fma");
                if fma
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                {
                    // SAFETY: the features were detected just above.
                    return unsafe { avx512($($arg),*) };
                }
                if fma && is_x86_feature_detected!("avx2") {
                    // SAFETY: the features were detected just above.
                    return unsafe { avx2($($arg),*) };
                }
            }
            body($($arg),*)
        }
    };
}

/// exp with a relative error under 3e-7 in [-87, 88], without branch or table.
#[inline(always)]
fn exp(x: f32) -> f32 {
    // Adding 1.5 * 2^23 rounds to an integer and leaves it in the low bits of the mantissa.
    const ROUND: f32 = 12_582_912.0;
    let x = x.clamp(-87.0, 88.0);
    let shifted = x.mul_add(std::f32::consts::LOG2_E, ROUND);
    let n = shifted - ROUND;
    // ln 2 in two parts keeps the remainder exact.
    let r = n.mul_add(-1.428_606_8e-6, n.mul_add(-0.693_145_75, x));
    let mut p = 1.388_888_9e-3_f32;
    for c in [8.333_334e-3, 4.166_666_6e-2, 0.166_666_67, 0.5, 1.0, 1.0] {
        p = p.mul_add(r, c);
    }
    p * f32::from_bits((shifted.to_bits() << 23).wrapping_add(1.0_f32.to_bits()))
}

#[inline(always)]
fn tanh_pair(z: f32) -> (f32, f32) {
    let t = 1.0 - 2.0 / (1.0 + exp(2.0 * z));
    (t, 1.0 - t * t)
}

/// GELU in its tanh form, and its derivative.
#[inline(always)]
fn gelu_pair(z: f32) -> (f32, f32) {
    const TWICE_SQRT_2_PI: f32 = 1.595_769;
    const CUBIC: f32 = 0.044_715;
    let square = z * z;
    let s = 1.0 / (1.0 + exp(-TWICE_SQRT_2_PI * z * square.mul_add(CUBIC, 1.0)));
    let inner = TWICE_SQRT_2_PI * square.mul_add(3.0 * CUBIC, 1.0);
    (z * s, (z * inner * (1.0 - s)).mul_add(s, s))
}

#[inline(always)]
fn activate(z: &mut [f32], bias: &[f32], h: &mut [f32], pair: impl Fn(f32) -> (f32, f32)) {
    let width = bias.len();
    for (z, h) in z.chunks_exact_mut(width).zip(h.chunks_exact_mut(width)) {
        for ((z, h), bias) in z.iter_mut().zip(h).zip(bias) {
            let (value, slope) = pair(*z + *bias);
            *h = value;
            *z = slope;
        }
    }
}

multiversion! {
    /// `h = gelu(z + bias)`, `z = gelu'(z + bias)`.
    fn gelu(z: &mut [f32], bias: &[f32], h: &mut [f32]) { activate(z, bias, h, gelu_pair); }
}

multiversion! {
    /// `h = tanh(z + bias)`, `z = tanh'(z + bias)`.
    fn tanh(z: &mut [f32], bias: &[f32], h: &mut [f32]) { activate(z, bias, h, tanh_pair); }
}

multiversion! {
    /// `z += bias` in each column.
    fn add_bias(z: &mut [f32], bias: &[f32]) {
        for z in z.chunks_exact_mut(bias.len()) {
            for (z, bias) in z.iter_mut().zip(bias) {
                *z += *bias;
            }
        }
    }
}

multiversion! {
    /// `slope *= dh`, and the bias gradient gains the sum over columns.
    fn activation_backward(dh: &[f32], slope: &mut [f32], bias_gradient: &mut [f32]) {
        let width = bias_gradient.len();
        for (dh, slope) in dh.chunks_exact(width).zip(slope.chunks_exact_mut(width)) {
            for ((dh, slope), sum) in dh.iter().zip(slope).zip(bias_gradient.iter_mut()) {
                *slope *= *dh;
                *sum += *slope;
            }
        }
    }
}

multiversion! {
    /// The bias gradient gains the sum over columns.
    fn sum_columns(dz: &[f32], bias_gradient: &mut [f32]) {
        for dz in dz.chunks_exact(bias_gradient.len()) {
            for (sum, dz) in bias_gradient.iter_mut().zip(dz) {
                *sum += *dz;
            }
        }
    }
}

/// Sum of `f(a, b)` with 32 running sums: a strict sum does not vectorise.
#[inline(always)]
fn sum2(a: &[f32], b: &[f32]) -> (f32, f32) {
    let (mut sums, mut products) = ([0.0_f32; 32], [0.0_f32; 32]);
    let (whole_a, rest_a) = a.as_chunks::<32>();
    let (whole_b, rest_b) = b.as_chunks::<32>();
    for (a, b) in whole_a.iter().zip(whole_b) {
        for i in 0..32 {
            sums[i] += a[i];
            products[i] = a[i].mul_add(b[i], products[i]);
        }
    }
    for (i, (a, b)) in rest_a.iter().zip(rest_b).enumerate() {
        sums[i] += a;
        products[i] = a.mul_add(*b, products[i]);
    }
    (sums.iter().sum(), products.iter().sum())
}

const EPSILON: f32 = 1e-6;

multiversion! {
    /// Layer norm of each column: `x` becomes the standardised value, `y = gain x + shift`.
    fn layer_norm(x: &mut [f32], y: &mut [f32], gain: &[f32], shift: &[f32], scale: &mut [f32]) {
        let width = gain.len();
        let share = 1.0 / width as f32;
        let columns = x.chunks_exact_mut(width).zip(y.chunks_exact_mut(width)).zip(scale);
        for ((x, y), scale) in columns {
            let (sum, squares) = sum2(x, x);
            let mean = sum * share;
            let variance = (squares * share - mean * mean).max(0.0);
            *scale = 1.0 / (variance + EPSILON).sqrt();
            for (((x, y), gain), shift) in x.iter_mut().zip(y).zip(gain).zip(shift) {
                *x = (*x - mean) * *scale;
                *y = x.mul_add(*gain, *shift);
            }
        }
    }
}

multiversion! {
    /// Gradient of [`layer_norm`]: `dy` becomes the gradient of its input.
    fn layer_norm_backward(
        dy: &mut [f32],
        x: &[f32],
        gain: &[f32],
        scale: &[f32],
        gain_gradient: &mut [f32],
        shift_gradient: &mut [f32],
    ) {
        let width = gain.len();
        let share = 1.0 / width as f32;
        for ((dy, x), scale) in dy.chunks_exact_mut(width).zip(x.chunks_exact(width)).zip(scale) {
            for i in 0..width {
                gain_gradient[i] = dy[i].mul_add(x[i], gain_gradient[i]);
                shift_gradient[i] += dy[i];
                dy[i] *= gain[i];
            }
            let (sum, product) = sum2(dy, x);
            let (mean, along) = (sum * share, product * share);
            for (dy, x) in dy.iter_mut().zip(x) {
                *dy = (*dy - x.mul_add(along, mean)) * *scale;
            }
        }
    }
}

multiversion! {
    /// One Adam step; `rates` are step size / bias correction 1, sqrt(bias correction 2), beta 1,
    /// beta 2, epsilon.
    fn adam(
        parameters: &mut [f32],
        gradient: &[f32],
        first: &mut [f32],
        second: &mut [f32],
        rates: [f32; 5],
    ) {
        let [step, root, beta1, beta2, epsilon] = rates;
        for (((p, g), m), v) in parameters.iter_mut().zip(gradient).zip(first).zip(second) {
            *m = (*g - *m).mul_add(1.0 - beta1, *m);
            *v = (*g * *g - *v).mul_add(1.0 - beta2, *v);
            *p -= step * *m / v.sqrt().mul_add(root, epsilon);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_within_three_ulp() {
        for i in -8000..8000 {
            let x = i as f32 / 100.0;
            let exact = f64::from(x).exp();
            let error = (f64::from(exp(x)) - exact).abs() / exact;
            assert!(error < 4e-7, "exp({x}) is off by {error}");
        }
    }

    #[test]
    fn slopes_are_finite_differences() {
        for pair in [gelu_pair, tanh_pair] {
            for i in -40..40 {
                let z = i as f32 / 10.0;
                let numeric = (pair(z + 1e-2).0 - pair(z - 1e-2).0) / 2e-2;
                assert!((numeric - pair(z).1).abs() < 2e-3, "at {z}");
            }
        }
    }
}
