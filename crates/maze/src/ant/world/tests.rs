use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::CONTROL_SECONDS;
use crate::ant::JOINT_RANGES;

fn medium() -> AntMaze {
    AntMaze::new(&Layout::named("medium").unwrap(), Physics::MAZE)
}

#[test]
fn the_ant_weighs_what_mujoco_says() {
    let inertias = medium().inertias();
    let mass: f32 = inertias.iter().map(|[mass, ..]| mass).sum();
    assert!((mass - 0.91088).abs() < 1e-4, "{mass}");
    let torso_mass = inertias[0][0];
    assert!((torso_mass - 0.483_882).abs() < 1e-4, "{torso_mass}");
    // A foot link: kg, and kg m^2 along and across.
    let [mass, mut i @ ..] = inertias[2];
    i.sort_by(f32::total_cmp);
    for (got, wanted) in [mass, i[0], i[1], i[2]]
        .iter()
        .zip([0.067_592, 2.094e-4, 2.675e-3, 2.675e-3])
    {
        assert!((got / wanted - 1.0).abs() < 1e-2, "{inertias:?}");
    }
}

#[test]
fn without_torque_it_settles_at_mujocos_standing_height() {
    let mut world = medium();
    world.reset_to([0.0, 0.0]);
    for _ in 0..60 {
        world.step(&[0.0; 8]);
    }
    // In MuJoCo 0.597 m after 20 steps, then 0.585: its friction lets the feet creep apart.
    let z = world.observation()[2];
    assert!((0.53..0.62).contains(&z), "{z}");
}

#[test]
fn set_is_read_back() {
    let mut world = medium();
    let mut o = world.observation();
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    for value in &mut o[7..] {
        *value = rng.random_range(-0.5..0.5);
    }
    let turn = 0.4_f32;
    o[3..7].copy_from_slice(&[(turn / 2.0).cos(), (turn / 2.0).sin(), 0.0, 0.0]);
    world.set(&o);
    for (got, wanted) in world.observation().iter().zip(&o) {
        assert!((got - wanted).abs() < 1e-5, "{got} {wanted}");
    }
}

#[test]
fn a_torque_moves_its_own_joint_as_mujoco_has_it() {
    let mut world = medium();
    world.reset_to([0.0, 0.0]);
    let mut action = [0.0; 8];
    action[2] = 1.0;
    world.step(&action);
    let o = world.observation();
    // 30 N m on hip 1 for one step in MuJoCo: 0.143 rad, 2.81 rad/s. Semi-implicit substeps
    // have positions half a substep ahead of velocities.
    let physics = Physics::MAZE;
    let substeps = physics.pipeline_steps * physics.solver_iterations;
    let ahead = o[21] * CONTROL_SECONDS / substeps as f32 / 2.0;
    assert!((o[7] - ahead - 0.143).abs() < 0.01, "{}", o[7] - ahead);
    assert!((o[21] - 2.81).abs() < 0.1, "{}", o[21]);
    for joint in [2, 4, 6] {
        assert!(
            o[7 + joint].abs() < 0.05,
            "hip of another leg moved: {}",
            o[7 + joint]
        );
    }
}

#[test]
fn random_actions_never_break_the_body() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let layout = Layout::named("medium").unwrap();
    let mut world = AntMaze::new(&layout, Physics::MAZE);
    let mut overshoot = 0.0_f32;
    for cell in layout.free_cells().into_iter().step_by(5) {
        world.reset(layout.centre(cell), &mut rng);
        for step in 0..400 {
            world.step(&std::array::from_fn(|_| rng.random_range(-1.0..=1.0)));
            let o = world.observation();
            assert!(o.iter().copied().all(f32::is_finite));
            assert!(o[2] < 2.0, "torso at {} m", o[2]);
            // The reset pose starts the ankles 30 degrees outside their range.
            if step >= 10 {
                for (joint, [low, high]) in JOINT_RANGES.into_iter().enumerate() {
                    overshoot = overshoot.max(low - o[7 + joint]).max(o[7 + joint] - high);
                }
            }
        }
        assert!(!layout.is_wall_at([world.observation()[0], world.observation()[1]]));
    }
    assert!(
        overshoot.to_degrees() < 8.0,
        "{} degrees",
        overshoot.to_degrees()
    );
}

#[test]
fn an_inlet_takes_the_ant_to_every_outlet_and_changes_nothing_else() {
    let layout = Layout::named("teleport").unwrap();
    let mut world = AntMaze::new(&layout, Physics::MAZE);
    let inlet = layout.centre(layout.inlets()[0]);
    let mut rng = Pcg64Mcg::seed_from_u64(0);
    let mut seen = std::collections::BTreeSet::new();
    for _ in 0..20 {
        world.reset([inlet[0] + 1.2, inlet[1]], &mut rng);
        let before = world.save();
        world.step(&[0.0; 8]);
        let o = world.observation();
        seen.insert(layout.cell_at([o[0], o[1]]).unwrap());
        for _ in 0..20 {
            world.step(&[0.0; 8]);
        }
        let end = world.observation();
        assert!(
            (end[0] - o[0]).hypot(end[1] - o[1]) < 1.0,
            "it stands: {end:?}"
        );
        world.restore(&before);
        world.step(&[0.0; 8]);
        assert_eq!(
            world.observation(),
            o,
            "a restored state takes the same exit"
        );
    }
    assert_eq!(seen.into_iter().collect::<Vec<_>>(), layout.outlets());
}

#[test]
fn the_same_seed_gives_the_same_bits_and_a_saved_state_continues() {
    let run = |world: &mut AntMaze, seed| {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        for _ in 0..50 {
            world.step(&std::array::from_fn(|_| rng.random_range(-1.0..=1.0)));
        }
        world.observation().map(f32::to_bits)
    };
    let (mut a, mut b) = (medium(), medium());
    // A used world resets to the same future as a new one.
    run(&mut b, 9);
    a.reset([0.0, 0.0], &mut Pcg64Mcg::seed_from_u64(4));
    b.reset([0.0, 0.0], &mut Pcg64Mcg::seed_from_u64(4));
    assert_eq!(run(&mut a, 5), run(&mut b, 5));
    let saved = a.save();
    let mut other = a.clone();
    let first = run(&mut a, 6);
    assert_eq!(run(&mut other, 6), first, "a clone goes the same way");
    a.restore(&saved);
    assert_eq!(run(&mut a, 6), first);
}
