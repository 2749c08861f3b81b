//! The simulator behind a pipe, for other languages: `cargo run --release -p maze --example pipe --
//! MAZE`, where MAZE is a maze's name, or `floor` for an endless floor.
//!
//! Commands come on standard input, answers go to standard output; numbers are f32, little-endian.
//!
//! | command | then | answer |
//! |---|---|---|
//! | `S` | an observation (29) | the observation after starting anew from it |
//! | `A` | an action (8) | the observation after a control step |
//! | `M` | - | mass (kg) and principal inertia (kg m^2, 3) of the 9 bodies |

use std::io::{Read, Write};

use maze::{ACTION, AntMaze, Layout, OBSERVATION, Observation, Physics};

fn numbers<const N: usize>(input: &mut impl Read) -> std::io::Result<[f32; N]> {
    let mut values = [0.0; N];
    for value in &mut values {
        let mut bytes = [0; 4];
        input.read_exact(&mut bytes)?;
        *value = f32::from_le_bytes(bytes);
    }
    Ok(values)
}

fn answer(output: &mut impl Write, values: &[f32]) -> std::io::Result<()> {
    for value in values {
        output.write_all(&value.to_le_bytes())?;
    }
    output.flush()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let name = std::env::args().nth(1).ok_or("name a maze, or 'floor'")?;
    let mut world = match name.as_str() {
        "floor" => AntMaze::new(&Layout::named("umaze")?, Physics::OPEN_FLOOR),
        name => AntMaze::new(&Layout::named(name)?, Physics::MAZE),
    };
    let mut input = std::io::BufReader::new(std::io::stdin().lock());
    let mut output = std::io::BufWriter::new(std::io::stdout().lock());
    let mut command = [0];
    while input.read(&mut command)? > 0 {
        match command[0] {
            b'S' => {
                let start: Observation = numbers::<OBSERVATION>(&mut input)?;
                world.set(&start);
                answer(&mut output, &world.observation())?;
            }
            b'A' => {
                world.step(&numbers::<ACTION>(&mut input)?);
                answer(&mut output, &world.observation())?;
            }
            b'M' => {
                let bodies = world.inertias();
                answer(&mut output, bodies.as_flattened())?;
            }
            other => return Err(format!("unknown command {other}").into()),
        }
    }
    Ok(())
}
